"""Terminal output: plain text, and tables that never break a word."""

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_ENDLESS = 100_000
"""Characters; wider than any table."""


def create_console(*, stderr: bool = False, soft_wrap: bool = True, width: int | None = None) -> "Console":
    """Return a console that prints text literally, without emoji codes or markup.

    `soft_wrap`: let the terminal wrap lines; False for output that is redrawn, such as a progress bar.
    `width`: characters; None: the terminal's width.
    """
    from rich.console import Console  # noqa: PLC0415 - not needed for plain sentences

    return Console(
        stderr=stderr, soft_wrap=soft_wrap, width=width, highlight=False, markup=False, emoji=False
    )


def print_parts(parts: "Iterable[str | Table]", width: int | None = None) -> None:
    """Print sentences and tables to standard output, in this order."""
    for part in parts:
        if not isinstance(part, str):
            print_table(create_console(width=width), part)
        elif part.isprintable():
            sys.stdout.write(f"{part}\n")
            sys.stdout.flush()
        else:
            create_console().print(part)


def print_table(console: "Console", table: "Table") -> None:
    """Print a table; row by row if its columns do not fit side by side without breaking words."""
    from rich.measure import Measurement  # noqa: PLC0415

    wide = console.options.update(max_width=_ENDLESS)
    columns = [
        [Measurement.get(console, wide, cell) for cell in (column.header, *column.cells)]
        for column in table.columns
    ]
    least = [max(cell.minimum for cell in cells) for cells in columns]
    widths = [max(cell.maximum for cell in cells) for cells in columns]
    room = console.width - (Measurement.get(console, wide, table).maximum - _total(widths))
    if _total(least) > room:
        _print_rows(console, table)
        return
    if _total(widths) > room:
        for column, width in zip(table.columns, _narrowed(widths, least, room), strict=True):
            column.width = width
    console.print(table)


def _total(widths: list[int]) -> int:
    return sum(int(width) for width in widths)


def _narrowed(widths: list[int], least: list[int], room: int) -> list[int]:
    """Return widths that fit: the widest columns shrink first, none below its minimum."""
    fitting = list(widths)
    while _total(fitting) > room:
        _, place = max((width, place) for place, width in enumerate(fitting) if width > least[place])
        fitting[place] -= 1
    return fitting


def _print_rows(console: "Console", table: "Table") -> None:
    """Print each row's first cell, then its other cells below, each after its column title."""
    if table.title:
        console.print(table.title)
    heads = [str(column.header) for column in table.columns]
    for first, *others in zip(*(column.cells for column in table.columns), strict=True):
        console.print(first)
        for head, cell in zip(heads[1:], others, strict=True):
            if text := str(cell).replace("\n", "\n    "):
                console.print(f"  {head}: {text}" if head else f"  {text}")
