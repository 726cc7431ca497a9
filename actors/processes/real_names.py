"""What isolated robots saw under other names: kept in the run's folder, where none of them can read it."""

from typing import Final

import msgspec

NAMES: Final = "names.json"
"""File in a run's folder with what isolated robots saw under other names."""


class RealNames(msgspec.Struct, frozen=True):
    """What was called otherwise for the robots of a run; absolute paths."""

    out: str
    """The run's folder; a robot's own lies in it."""
    code: tuple[str, ...] = ()
    """The folders that a strategy was looked for in."""
