"""How far a run is, for a person at a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from actors.instant import in_seconds
from actors.messages import Progress as ProgressMessage


@contextmanager
def shown(duration_us: int, places: int, *, quiet: bool) -> Iterator[Callable[[ProgressMessage], None]]:
    """A bar on standard error that follows what it is told; nothing at all if `quiet` or in no terminal."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda message: None
        return
    columns = (
        TextColumn("{task.fields[what]}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s simulated"),
        TextColumn("{task.fields[places]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=in_seconds(duration_us), what="starting", places="")

        def follow(message: ProgressMessage) -> None:
            bar.update(
                task,
                completed=in_seconds(message.instant),
                what="running",
                places=f"{message.reports} of {places} places",
            )

        yield follow
