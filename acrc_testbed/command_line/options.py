"""Arguments and options that several commands have, each with one meaning."""

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.installation.repository import SHIPPED

if TYPE_CHECKING:
    from rich.table import Table


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


def option(metavar: str, text: str, *names: str, **others: Any) -> Any:
    """Declare an option with a value, by default named as its parameter; `text`: its help."""
    return typer.Option(*names, metavar=metavar, help=text, **others)


def flag(text: str, *names: str) -> Any:
    """Declare an option without a value; `text`: its help."""
    return typer.Option(*names, help=text)


def isolation(text: str) -> Any:
    """Declare `--isolate/--no-isolate`, by default None: where the machine can."""
    return flag(f"{text}  [default: where the machine can]", "--isolate/--no-isolate")


def argument(metavar: str, text: str, **others: Any) -> Any:
    """Declare an argument."""
    return typer.Argument(metavar=metavar, help=text, **others)


ScenarioFile = Annotated[
    Path | None,
    argument(
        "SCENARIO.toml",
        "Scenario to run.  [default: scenarios/chapter.toml, the chapter's experiment]",
        autocompletion=scenarios,
    ),
]
FleetFile = Annotated[Path, argument("FLEET.toml", "Fleet file: which robots there are.")]
Json = Annotated[bool, flag("Print JSON on standard output, and nothing else there.", "--json")]
OperatorKeys = Annotated[Path, option("DIR", "The operator's keys, from `acrc fleet keys`.")]
Endpoints = Annotated[list[str], argument("ENDPOINT…", "Where robots listen, such as tls/192.168.1.12:7447.")]
Modules = Annotated[
    list[Path] | None, option("DIR", "Load strategies from this folder, too. Repeatable.", "--modules")
]
Record = Annotated[
    str,
    option(
        "full|lean",
        "Record also what viewers and exports show of each robot's inside (full), or only what results "
        "and causes need (lean).",
        autocompletion=lambda: ["full", "lean"],
    ),
]
Trust = Annotated[
    bool, flag("Run the code that the file names, even if it lies elsewhere or has changed.", "--trust")
]
Robots = Annotated[str | None, option("N", "How many robots.")]
Seed = Annotated[str | None, option("N", "Random seed: the same one gives the same run.")]
Setting = Annotated[
    list[str] | None,
    option("KEY=VALUE", "Replace a key of the scenario: deeco.publish=0.5. Repeatable.", "--set"),
]


def _plain(value: Any) -> Any:
    """Return the number of a numpy scalar, and anything else as text."""
    return value.item() if hasattr(value, "item") else str(value)


def answer(shown: "Iterable[str | Table]", told: object, *, json: bool) -> None:
    """Print sentences and tables for people or, with `json`, `told` as one line of JSON."""
    if json:
        import msgspec

        sys.stdout.write(msgspec.json.encode(told, enc_hook=_plain).decode() + "\n")
        return
    from actors.console import show

    show(shown)
