"""What a benchmark measured, or the check of a claim found: for programs, for people, and a verdict."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rich.console import Console
from rich.table import Table

_WIDTH: Final = 250
"""Characters that the widest table needs, where no terminal says how wide it is."""


@dataclass(frozen=True)
class Measured:
    """The figures, and how a person reads them."""

    figures: Any
    """For JSON."""
    shown: Sequence[Table | str]
    """Tables and sentences, in their order."""
    holds: bool | None = None
    """Whether what was claimed holds; None: nothing was claimed."""

    def show(self) -> None:
        """Print it for people, on standard output."""
        console = Console() if sys.stdout.isatty() else Console(width=_WIDTH)
        for one in self.shown:
            console.print(one, highlight=False, markup=False, soft_wrap=isinstance(one, str))


def table_of(rows: Sequence[Mapping[str, object]], title: str) -> Table:
    """The rows, at least one, as a table; each has the same columns, by name, in this order."""
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*map(str, row.values()))
    return table
