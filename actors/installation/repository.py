"""Where this project lies: a clone, to which the installed packages lead, or the packages of a wheel."""

from pathlib import Path
from typing import Final

from actors.runtime.errors import AcrcError

REPOSITORY: Final = Path(__file__).resolve().parents[2]
"""The folder of the packages; in a clone its root."""

IS_CLONE: Final = (REPOSITORY / "pyproject.toml").is_file()

SHIPPED: Final = REPOSITORY if IS_CLONE else Path(__file__).resolve().parent / "shipped"
"""The folder with maps, scenarios, studies, fleets and constraints.txt. In a wheel, too, they lie beside one
another, since scenarios name their maps by relative paths; in a clone `shipped` has links to them."""

PACKAGES: Final = frozenset({"acrc_testbed", "actors", "cleaning", "deeco", "deploy", "firmware_bridge"})
"""What is installed of it (pyproject.toml); whatever else lies here is not this project's code."""


def clone(command: str) -> Path:
    """The root of the clone, for a command that works nowhere else. Raises AcrcError."""
    if not IS_CLONE:
        raise AcrcError(f"{command}: requires a clone of the repository (got a wheel in {REPOSITORY})")
    return REPOSITORY
