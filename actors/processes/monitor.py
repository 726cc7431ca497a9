"""Monitoring of processes: who stalls a run, and what robots use of disk and memory.

A process is charged with its own time only: what it works, and what it lets pass without working. Time spent
waiting for a processor or a disk is not charged, nor is time while a process is stopped. So a loaded machine,
a hundred robots that start at once, and a suspended laptop are no stalls.
"""

import math
import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from actors.processes.launch import Child
from actors.runtime import process_table
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process_table import ProcessGlance


class HoldUp(msgspec.Struct, frozen=True):
    """Steps that one actor has delayed: time in which no other could go on, and that it spent itself."""

    steps: int = 0
    """Steps delayed by a second or more."""
    most_s: float = 0.0
    """The longest delay, s of wall clock."""
    total_s: float = 0.0
    """All delays together, s of wall clock."""

    def and_one(self, lasted_s: float) -> "HoldUp":
        """Return it with one more step."""
        return HoldUp(self.steps + 1, max(self.most_s, lasted_s), self.total_s + lasted_s)


def sentences(held_up: Mapping[str, HoldUp]) -> Iterator[str]:
    """Yield who has delayed the run, the longest first."""
    for name, one in sorted(held_up.items(), key=lambda item: -item[1].total_s):
        steps = "1 step" if one.steps == 1 else f"{one.steps} steps"
        yield f"{name} held up {steps}, by {one.most_s:.1f} s at most, {one.total_s:.1f} s in all."


WORLD: Final = "the world has not taken a step"


@dataclass(frozen=True)
class Timeout:
    """How long a run may take no step."""

    step_s: float = 30.0
    """Time of its own that the awaited process spends on one step, working or not, s. Own choice: hundreds of
    times what the slowest step of a shipped strategy takes."""
    start_factor: float = 10.0
    """How many times more processor time a process may spend until it is ready; own choice: with nothing
    compiled yet, a slow computer needs two minutes for its first start."""
    working_share: float = 0.05
    """Where the system does not say how long a process waited for a processor: one that used this share of
    one processor or more since the last look was working; own choice: one that looks again and again whether
    something has come uses less."""
    look_s: float = 0.5
    """Time between two looks; own choice. One that comes much later counts as twice this, for then this
    process itself was stopped, or got no processor."""
    hold_up_s: float = 1.0
    """A step that took so much of one actor's own time was held up by it, s; own choice: a hundred times what
    a step usually takes."""


OUT_OF_SIGHT: Final = "?"
"""State of a process on a host without a connection. Its time is not charged."""


class Suspect(NamedTuple):
    """A process that is waited for."""

    name: str
    pid: int


class Stall(NamedTuple):
    """The process that stalls the run, with a sentence."""

    suspect: Suspect
    sentence: str


Phase = Literal["start", "step", "end"]
"""What is waited for: a first step, for which more processor time is granted; a step; or an exit. Only steps
count as held up, and only of them long waits are reported."""


@dataclass
class _Account:
    """What one suspect did since the last step, s."""

    cpu_s: float
    """Of its processes since their start, at the last look."""
    queued_s: float | None
    """The same for waiting for a processor, that of the world's among it."""
    watched_s: float = 0.0
    idle_s: float = 0.0
    worked_s: float = 0.0
    doing: str = ""


class StallDetector:
    """Charges processes with the time since the last step, and names the one that exceeds its limit."""

    LONG_S: Final = 10.0
    """A wait is reported once it has lasted so long, and again whenever that has doubled."""
    MUCH_S: Final = 5.0
    """What one actor has held up in all is reported from here on, and again whenever it has doubled."""
    MOST_NAMES: Final = 3

    def __init__(
        self,
        timeout: Timeout,
        say: Callable[[str], None] = lambda sentence: None,
        clock: Callable[[], float] = time.monotonic,
        table: Callable[[], Mapping[int, ProcessGlance]] = process_table.table,
        queued_s: Callable[[int], float | None] = process_table.queued_s,
    ) -> None:
        """`say`: is given notices for the user. `table`, `queued_s`: as of `process_table`."""
        self._timeout = timeout
        self._say = say
        self._clock = clock
        self._table = table
        self._queued = queued_s
        self._looked = clock()
        self._accounts: dict[Suspect, _Account] = {}
        self._past: dict[str, HoldUp] = {}
        self._phase: Phase = "step"
        self._lasted_s = 0.0
        self._next_notice_s = self.LONG_S
        self._next_of: dict[str, float] = {}
        self.stopped: frozenset[str] = frozenset()
        """Who was held by a signal at the last look."""

    @property
    def held_up(self) -> dict[str, HoldUp]:
        """Delayed steps so far, by actor, this one included; without the world, which keeps the pace."""
        found = dict(self._past)
        if self._phase != "step":
            return found
        for suspect, account in self._accounts.items():
            # before the first two looks it did what it did between them
            if account.watched_s and suspect.name not in ("", "world"):
                own = (account.idle_s + account.worked_s) / account.watched_s
                if (lasted_s := min(own, 1.0) * self._lasted_s) >= self._timeout.hold_up_s:
                    found[suspect.name] = found.get(suspect.name, HoldUp()).and_one(lasted_s)
        return found

    def step(self) -> None:
        """Begin anew: a step was taken, or what was awaited has happened."""
        now = self._clock()
        if self._accounts:
            self._pass(now)
            self._past = self.held_up
        self._looked = now
        self._accounts.clear()
        self._phase, self._lasted_s, self._next_notice_s = "step", 0.0, self.LONG_S
        self.stopped = frozenset()
        for name, one in self._past.items():
            if one.total_s >= self._next_of.get(name, self.MUCH_S):
                self._next_of[name] = 2 * one.total_s
                self._say(next(sentences({name: one})))

    def doing(self, suspect: Suspect) -> str:
        """Return what it did at the last look, in words; "" without a look."""
        account = self._accounts.get(suspect)
        return account.doing if account else ""

    def check(
        self, everyone: Sequence[Suspect], awaited: Sequence[Suspect], what: str, phase: Phase = "step"
    ) -> Stall | None:
        """Return the process of `awaited` that has exceeded its limit, if any; `what` they are awaited for.

        `everyone`: all processes of the run; none is named while one of them is stopped, or while one that
        is awaited is out of sight.
        """
        now = self._clock()
        if now - self._looked < self._timeout.look_s:
            return None
        elapsed_s = self._pass(now)
        known = self._table()
        trees = {one.pid: process_table.descendants((one.pid,), known) for one in everyone}
        self._note_stopped({one.name for one in everyone if any(known[p].stopped for p in trees[one.pid])})
        # what a suspect waits for may still lie with the world, which is its router
        link = {pid for one in everyone if one.name == "world" for pid in trees[one.pid]}
        self._phase = phase
        for suspect in awaited:
            tree = trees.get(suspect.pid, set())
            self._charge(suspect, {pid: known[pid] for pid in tree}, tree | link, elapsed_s)
        found = None
        if not self.stopped and all(self._accounts[one].doing != _UNSEEN for one in awaited):
            found = next((stall for one in awaited if (stall := self._judge(one, what))), None)
        if found is None and phase == "step" and self._lasted_s >= self._next_notice_s:
            self._next_notice_s *= 2
            told = [f"{one.name} {self.doing(one)}" for one in awaited[: self.MOST_NAMES]]
            more = [f"and {len(awaited) - len(told)} more"] if len(awaited) > len(told) else []
            self._say(f"{what} for {self._lasted_s:.0f} s; {', '.join(told + more)}")
        return found

    def _note_stopped(self, stopped: Collection[str]) -> None:
        if stopped and stopped != self.stopped:
            self._say(f"{', '.join(sorted(stopped))} stopped by a signal; the run waits for SIGCONT")
        self.stopped = frozenset(stopped)

    def _pass(self, now: float) -> float:
        """Return the time since the last look, as far as it counts."""
        elapsed_s = min(now - self._looked, 2 * self._timeout.look_s)
        self._looked = now
        self._lasted_s += elapsed_s
        return elapsed_s

    def _charge(
        self, suspect: Suspect, tree: Mapping[int, ProcessGlance], carriers: Collection[int], elapsed_s: float
    ) -> None:
        queued = [waited for pid in carriers if (waited := self._queued(pid)) is not None]
        now = _Account(math.fsum(one.cpu_s for one in tree.values()), math.fsum(queued) if queued else None)
        before = self._accounts.setdefault(suspect, now)
        worked_s, waited_s = max(now.cpu_s - before.cpu_s, 0.0), None
        if now.queued_s is not None and before.queued_s is not None:
            waited_s = max(now.queued_s - before.queued_s, 0.0)
        before.cpu_s, before.queued_s = now.cpu_s, now.queued_s
        working = worked_s >= self._timeout.working_share * elapsed_s
        before.doing = _doing(tree, working=working)
        if before is now or self.stopped:
            return
        before.watched_s += elapsed_s
        before.worked_s += worked_s
        if before.doing in (_ON_DISK, _UNSEEN):
            return
        if waited_s is not None:
            before.idle_s += max(elapsed_s - worked_s - waited_s, 0.0)
        elif not working and not any(one.state == "R" for one in tree.values()):
            before.idle_s += elapsed_s

    def _judge(self, suspect: Suspect, what: str) -> Stall | None:
        account = self._accounts[suspect]
        limit_s = self._timeout.step_s
        factor = self._timeout.start_factor if self._phase == "start" else 1.0
        idle_s, busy_s = account.idle_s, account.worked_s / factor
        if idle_s + busy_s < limit_s:
            return None
        if busy_s < _LITTLE * limit_s:
            return Stall(suspect, f"{what} for {limit_s:g} s")
        if idle_s < _LITTLE * limit_s:
            return Stall(suspect, f"{what} after {limit_s * factor:g} s of processor time")
        lasted_s = idle_s + account.worked_s
        share = f"{account.worked_s:.0f} s of them processor time"
        return Stall(suspect, f"{what} for {lasted_s:.0f} s, {share}")


_LITTLE: Final = 0.2
"""A share of the time that no sentence mentions."""
_ON_DISK: Final = "waits for a disk"
_UNSEEN: Final = "is on a host of which nothing is heard"


def _doing(tree: Mapping[int, ProcessGlance], *, working: bool) -> str:
    """Return what a process and all that it has started do."""
    if any(one.stopped for one in tree.values()):
        return "is stopped"
    if any(one.state == OUT_OF_SIGHT for one in tree.values()):
        return _UNSEEN
    if working or any(one.state == "R" for one in tree.values()):
        return "works, or waits for a processor"
    parents = {one.parent for one in tree.values()}
    asleep = [pid for pid, one in tree.items() if one.state == "D"]
    if any(pid not in parents for pid in asleep):
        return _ON_DISK
    # a process whose child has its memory sleeps as if for a disk, until the child lets go of it (vfork(2))
    return "waits for a process of its own" if asleep else "does nothing"


_MB: Final = 1_000_000
_BLOCK: Final = 512
"""stat(2) counts in such blocks, bytes."""
_KEEPERS: Final = 2
"""Processes that isolation adds to a robot's own."""


class DiskUse(NamedTuple):
    """Content of a folder."""

    size: int
    """Bytes on disk, without holes in files."""
    files: int
    """Files, folders and links."""


class ResourceWatch:
    """Periodic check of what the system does not limit: a robot's folder, and all its processes together."""

    INTERVAL_S: Final = 0.5
    """Time between two checks; own choice: a fast disk takes a GB in it, and so does memory."""
    SHARE: Final = 2
    """The next check is delayed by so many times the last one's duration, if that is more: robots with very
    many files must not gain time."""

    def __init__(self, limits: ProcessLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._next_s = clock() + self.INTERVAL_S

    def fault(self, children: Iterable[Child]) -> str | None:
        """Return a sentence on the first robot above its limits; None if there is none or no check is due."""
        began_s = self._clock()
        if began_s < self._next_s:
            return None
        robots = [child for child in children if child.program.module == "actors.robot"]
        known = process_table.table() if robots else {}
        found = next((fault for child in robots if (fault := self._fault(child, known))), None)
        now_s = self._clock()
        self._next_s = now_s + max(self.INTERVAL_S, self.SHARE * (now_s - began_s))
        return found

    def _fault(self, child: Child, known: Mapping[int, ProcessGlance]) -> str | None:
        limits, folder = self._limits, child.program.log.parent
        disk = disk_use(folder, limits.disk_mb * _MB, limits.disk_files)
        # its process, its keeper and all that it has started, also what has left the family
        session = {pid for pid, one in known.items() if one.session == child.pid}
        family = process_table.descendants({child.pid, *session}, known)
        holdings = [process_table.held(pid) for pid in family]
        memory = math.fsum(one.memory for one in holdings)
        threads = math.fsum(one.threads for one in holdings)
        isolated = child.program.names is not None
        for exceeded, what, limit in (
            (
                disk.size > limits.disk_mb * _MB,
                f"written more than {limits.disk_mb} MB to {folder}",
                "disk_mb",
            ),
            (
                disk.files > limits.disk_files,
                f"made more than {limits.disk_files} files in {folder}",
                "disk_files",
            ),
            (
                memory > limits.memory_mb * _MB,
                f"taken more than {limits.memory_mb} MB of memory with all its processes",
                "memory_mb",
            ),
            (
                isolated and threads > limits.processes + _KEEPERS,
                f"more than {limits.processes} processes and threads",
                "processes",
            ),
        ):
            if exceeded:
                return f"{child.program.actor} has {what}; --limit {limit}=N allows more"
        return None


def disk_use(folder: Path, most_size: int, most_files: int) -> DiskUse:
    """Return the use below `folder`, links not followed; counted until one of the two limits is exceeded."""
    size = files = 0
    folders = [str(folder)]
    while folders:
        with suppress(OSError), os.scandir(folders.pop()) as entries:  # the robot may remove or close it
            for entry in entries:
                files += 1
                with suppress(OSError):
                    size += entry.stat(follow_symlinks=False).st_blocks * _BLOCK
                if size > most_size or files > most_files:
                    return DiskUse(size, files)
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
    return DiskUse(size, files)
