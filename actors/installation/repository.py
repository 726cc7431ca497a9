"""Location of this project: a clone, also if installed in editable mode, or the packages of a wheel."""

from pathlib import Path
from typing import Final

from actors.runtime.errors import AcrcError

REPOSITORY: Final = Path(__file__).resolve().parents[2]
"""Folder of the packages; in a clone, its root."""

IS_CLONE: Final = (REPOSITORY / "pyproject.toml").is_file()

SHIPPED: Final = REPOSITORY if IS_CLONE else Path(__file__).resolve().parent / "shipped"
"""Folder with maps, scenarios, studies, fleets and constraints.txt; in a clone, `shipped` has links to them.
In a wheel, too, they are siblings, since scenarios refer to maps by relative paths."""

PACKAGES: Final = frozenset(
    {"acrc_testbed", "actors", "cleaning", "deeco", "deploy", "firmware_bridge", "logistics"}
)
"""Installed packages (pyproject.toml); all other code here is not this project's."""


def clone(command: str) -> Path:
    """Return the clone's root, for a command that requires a clone. Raises AcrcError."""
    if not IS_CLONE:
        raise AcrcError(f"{command}: requires a clone of the repository (got a wheel in {REPOSITORY})")
    return REPOSITORY
