"""The table of digests: all tasks on all computers."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from actors.console import screen
from actors.installation.repository import REPOSITORY, SHIPPED
from benchmarks.processors import aarch64, pythons
from benchmarks.processors.computer import Computer, RunOutcome, RunTask, here, make
from benchmarks.statistics.measured import Measured

_BUILT: Final = REPOSITORY / ".processors"
"""Where what is built is kept."""
_CROWD_S: Final = 65.0
"""Simulated time of the house test's run, whose events all lie in it."""
_PATIENCE_S: Final = 3600.0
_SHOWN: Final = 12
"""Digits of a digest."""


@dataclass(frozen=True)
class ProcessorRow:
    """What became of all tasks on one computer."""

    computer: str
    outcomes: Mapping[str, RunOutcome]
    """By title of the task."""


def tasks(seconds: float, crowd_seconds: float) -> list[RunTask]:
    """The house test's crowd, with a contact every second, and the chapter's four robots as the original."""
    crowd = RunTask("crowd", REPOSITORY / "tests" / "swarm" / "crowd.toml", crowd_seconds)
    chapter = RunTask("chapter", SHIPPED / "scenarios" / "chapter.toml", seconds, 4, "chapter")
    return [crowd, chapter]


def computers(folder: Path, install: bool, only: Sequence[str] = ()) -> Iterable[Computer]:
    """All whose name has one of the words, or all where there is none, built one after the other."""

    def wanted(name: str) -> bool:
        return not only or any(word in name for word in only)

    yield from (one for one in here() if wanted(one.name))
    yield from pythons.computers(folder, wanted)
    if wanted(aarch64.NAME):
        yield aarch64.computer(folder, install)


def measure(
    wanted: Sequence[RunTask],
    candidates: Iterable[Computer],
    folder: Path,
    on_row: Callable[[ProcessorRow], None],
) -> list[ProcessorRow]:
    """Make every run; each row is told as soon as it is known."""
    rows = []
    for one in candidates:
        outcomes = {task.title: make(task, one, folder / "runs", _PATIENCE_S) for task in wanted}
        rows.append(ProcessorRow(one.name, outcomes))
        on_row(rows[-1])
    return rows


def digests(rows: Iterable[ProcessorRow], title: str) -> set[str]:
    """The different ones of a task."""
    return {row.outcomes[title].digest for row in rows} - {""}


def line(row: ProcessorRow) -> str:
    """A row for people."""
    faults = {outcome.fault for outcome in row.outcomes.values() if outcome.fault}
    cells = [outcome.digest[:_SHOWN] or "-" for outcome in row.outcomes.values()]
    return (
        f"{row.computer:44s} "
        + "  ".join(f"{cell:{_SHOWN}s}" for cell in cells)
        + "".join(f"  {fault}" for fault in sorted(faults))
    )


def check(
    duration: float = 600.0, only: Sequence[str] = (), install: bool = False, folder: Path = _BUILT
) -> Measured:
    """Make two runs on each computer; it holds where there is one digest of each, and no run has failed.

    `duration`: of the chapter's run, simulated s. `only`: parts of the names of the computers that are
    wanted; none: all. `install`: let apt-get install what an emulator needs. `folder`: for what is built.
    """
    wanted = tasks(duration, _CROWD_S)
    console = screen(stderr=True)
    rows = measure(
        wanted, computers(folder, install, only), folder,
        lambda row: console.print(line(row).rstrip()),
    )  # fmt: skip
    found = {task.title: digests(rows, task.title) for task in wanted}
    heads = "  ".join(f"{f'{task.title}, {task.seconds:g} s':{_SHOWN}s}" for task in wanted)
    shown = [f"{'':44s} {heads}", *(line(row).rstrip() for row in rows)]
    shown += [f"{title}: {verdict(different)}" for title, different in found.items()]
    sound = all(len(different) == 1 for different in found.values()) and not any(map(failed, rows))
    return Measured([asdict(row) for row in rows], shown, sound)


def failed(row: ProcessorRow) -> bool:
    """True if a run on that computer gave no digest, although the computer is there."""
    return any(outcome.fault and outcome.ran for outcome in row.outcomes.values())


def verdict(different: set[str]) -> str:
    """What the digests of one task say."""
    if not different:
        return "no digest"
    return "one digest" if len(different) == 1 else f"{len(different)} digests, where there should be one"
