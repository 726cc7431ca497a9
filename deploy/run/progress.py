"""Progress of a run: a bar at a terminal, or a line every 10 s."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from actors.console import create_console
from actors.instant import in_seconds
from actors.messages import Progress as ProgressMessage
from actors.task.task import TaskDeclaration

if TYPE_CHECKING:
    from rich.console import Console

LINE_INTERVAL_S: Final = 10.0
"""Wall time between two lines, s."""


def line_printer(console: "Console") -> Callable[[str], None]:
    """Return a function that prints at most one line per LINE_INTERVAL_S."""
    last = time.monotonic()

    def print_line(line: str) -> None:
        nonlocal last
        if time.monotonic() - last >= LINE_INTERVAL_S:
            last = time.monotonic()
            console.print(f"acrc: {line}", soft_wrap=True)

    return print_line


@contextmanager
def show_progress(
    duration_us: int, items: int, task: TaskDeclaration, *, quiet: bool
) -> Iterator[Callable[[ProgressMessage], None]]:
    """Yield a function that shows a Progress message on standard error; `quiet`: it shows nothing.

    `items`: number of items that are known before the run.
    """
    console, total = create_console(stderr=True, soft_wrap=False), in_seconds(duration_us)
    if quiet:
        yield lambda message: None
        return
    if not console.is_terminal:
        print_line = line_printer(console)
        yield lambda message: print_line(
            f"{in_seconds(message.instant):.0f} of {total:.0f} s simulated, "
            f"{_done_text(message, items, task)}"
        )
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (
        TextColumn("{task.fields[what]}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s simulated"),
        TextColumn("{task.fields[items]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        shown = bar.add_task("", total=total, what="starting", items="")

        def follow(message: ProgressMessage) -> None:
            bar.update(
                shown,
                completed=in_seconds(message.instant),
                what="running",
                items=_done_text(message, items, task),
            )

        yield follow


def _done_text(message: ProgressMessage, items: int, task: TaskDeclaration) -> str:
    """Return the number of items done, of those known."""
    known = max(items, message.done + message.left)
    return f"{message.done} of {known} {task.items}"
