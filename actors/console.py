"""What people read in a terminal: words as they are, and tables in which no word is broken."""

from collections.abc import Iterable

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ENDLESS = 100_000
"""Characters; no table is as wide."""


def screen(*, stderr: bool = False, soft_wrap: bool = True, width: int | None = None) -> Console:
    """A console that shows what it is given: no colons become pictures, no brackets colours.

    `soft_wrap`: the terminal wraps lines; not for what is drawn again and again, such as a bar. `width`:
    characters; None: as many as the terminal has.
    """
    return Console(
        stderr=stderr, soft_wrap=soft_wrap, width=width, highlight=False, markup=False, emoji=False
    )


def show(parts: Iterable[str | Table], width: int | None = None) -> None:
    """Print sentences and tables on standard output, in their order."""
    console = screen(width=width)
    for part in parts:
        if isinstance(part, str):
            console.print(part)
        else:
            print_table(console, part)


def print_table(console: Console, table: Table) -> None:
    """Print a table; where its columns do not fit beside one another with every word whole, row by row."""
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
    """Widths that fit, the widest made narrower first, none less than it must be."""
    fitting = list(widths)
    while _total(fitting) > room:
        _, place = max((width, place) for place, width in enumerate(fitting) if width > least[place])
        fitting[place] -= 1
    return fitting


def _print_rows(console: Console, table: Table) -> None:
    """Each row's first cell, and below it all others, each behind the title of its column."""
    if table.title:
        console.print(table.title)
    heads = [str(column.header) for column in table.columns]
    for first, *others in zip(*(column.cells for column in table.columns), strict=True):
        console.print(first)
        for head, cell in zip(heads[1:], others, strict=True):
            if told := str(cell).replace("\n", "\n    "):
                console.print(f"  {head}: {told}" if head else f"  {told}")
