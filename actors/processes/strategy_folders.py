"""Where the code of a run's strategy lay: kept in the run's folder, where no isolated robot can read it."""

from typing import Final

import msgspec

NAMES: Final = "names.json"
"""File in the folder of a run with a strategy of the user's own."""


class StrategyFolders(msgspec.Struct, frozen=True):
    """What isolated robots saw under other names; absolute paths, as they were then."""

    out: str
    """The run's folder; a robot's own lies in it."""
    code: tuple[str, ...] = ()
    """The folders that a strategy was looked for in."""
