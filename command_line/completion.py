"""What the shell offers at the tabulator key. Where nothing is offered it completes files by itself."""

import os
from pathlib import Path

from actors.installation.repository import SHIPPED


def scenarios(incomplete: str) -> list[str]:
    """The shipped scenarios as seen from here, and the TOML files that lie here."""
    shipped = sorted((SHIPPED / "scenarios").glob("*.toml"))
    here = sorted(path.name for path in Path().glob("*.toml"))
    return [name for name in (*here, *map(os.path.relpath, shipped)) if name.startswith(incomplete)]


def strategies(incomplete: str) -> list[str]:
    """Names of strategies; none is imported."""
    from cleaning.strategies import strategies as known

    return [one.name for one in known() if one.name.startswith(incomplete)]


def orders(incomplete: str) -> list[str]:
    """Verbs of orders to a run."""
    from deploy.run.orders import VERBS

    return [verb for verb in VERBS if verb.startswith(incomplete)]


def navigation(incomplete: str) -> list[str]:
    """Presets of navigation."""
    from actors.robot.navigation.navigator import NAVIGATION_PRESETS

    return [name for name in NAVIGATION_PRESETS if name.startswith(incomplete)]
