"""Monitoring of processes: stalls of a run, and use of disk and memory by robots.

A process is charged only for its own time: running, or idle. Time waiting for a processor or a disk is not
charged, nor is time while a process is stopped. So a loaded machine, a hundred robots that start at once, and
a suspended laptop do not count as stalls.
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

from actors.processes.launcher import ChildProcess
from actors.runtime import process_table
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process_table import ProcessState


class StepDelays(msgspec.Struct, frozen=True):
    """Steps delayed by one actor: time that it spent itself and in which no other actor could continue."""

    steps: int = 0
    """Number of steps delayed by at least one second."""
    most_s: float = 0.0
    """Longest delay, s of wall-clock time."""
    total_s: float = 0.0
    """Sum of all delays, s of wall-clock time."""

    def plus_step(self, lasted_s: float) -> "StepDelays":
        """Return it with one more delayed step."""
        return StepDelays(self.steps + 1, max(self.most_s, lasted_s), self.total_s + lasted_s)


def delay_sentences(held_up: Mapping[str, StepDelays]) -> Iterator[str]:
    """Yield one sentence per actor that delayed the run, longest total first."""
    for name, one in sorted(held_up.items(), key=lambda item: -item[1].total_s):
        steps = "1 step" if one.steps == 1 else f"{one.steps} steps"
        yield f"{name} delayed {steps}, by up to {one.most_s:.1f} s, {one.total_s:.1f} s in total."


@dataclass(frozen=True)
class Timeout:
    """Timeouts of a run's steps."""

    step_s: float = 30.0
    """Own time of the awaited process per step, running or idle, s. Own choice: hundreds of times the slowest
    step of a shipped strategy."""
    start_factor: float = 10.0
    """Factor on the CPU time of a process until it is ready; own choice: without compiled kernels, a slow
    computer needs two minutes for its first start."""
    working_share: float = 0.05
    """CPU share since the last check from which a process counts as running, if the system does not report
    waiting times; own choice: a process that polls uses less."""
    check_interval_s: float = 0.5
    """Interval of checks, s; own choice. A much later check counts as twice this, since this process itself
    was stopped or got no processor."""
    delayed_s: float = 1.0
    """Own time of one actor, s, from which its step counts as delayed; own choice: a hundred times the usual
    duration."""


UNREACHABLE: Final = "?"
"""State of a process on an unreachable host. Its time is not charged."""


class AwaitedProcess(NamedTuple):
    """A process that the run waits for."""

    name: str
    pid: int


class Stall(NamedTuple):
    """The process that stalls the run, with a sentence."""

    suspect: AwaitedProcess
    sentence: str


Phase = Literal["start", "step", "end"]
"""Awaited event: a first step, with more CPU time allowed; a step; or an exit. Only steps count as delayed
and have long waits reported."""


class _ProcessTimes(msgspec.Struct):
    """Times of one suspect since the last step, s."""

    cpu_s: float
    """CPU time of its processes since their start, at the last check."""
    queued_s: float | None
    """Their time waiting for a processor, including the world's."""
    watched_s: float = 0.0
    idle_s: float = 0.0
    worked_s: float = 0.0
    activity: str = ""


class StallDetector:
    """Charges processes for the time since the last step, and finds the one that exceeds its timeout."""

    NOTICE_WAIT_S: Final = 10.0
    """A wait is reported after this time, and again whenever it has doubled, s."""
    NOTICE_TOTAL_S: Final = 5.0
    """Total delays of one actor are reported from here on, and again whenever they have doubled, s."""
    MAX_NAMES: Final = 3

    def __init__(
        self,
        timeout: Timeout,
        notify: Callable[[str], None] = lambda sentence: None,
        clock: Callable[[], float] = time.monotonic,
        table: Callable[[], Mapping[int, ProcessState]] = process_table.processes,
        queued_s: Callable[[int], float | None] = process_table.queued_s,
    ) -> None:
        """`notify`: called with notices for the user. `table`: lists all processes."""
        self._timeout = timeout
        self._notify = notify
        self._clock = clock
        self._table = table
        self._queued = queued_s
        self._checked_s = clock()
        self._times: dict[AwaitedProcess, _ProcessTimes] = {}
        self._earlier_delays: dict[str, StepDelays] = {}
        self._phase: Phase = "step"
        self._lasted_s = 0.0
        self._next_notice_s = self.NOTICE_WAIT_S
        self._next_notices: dict[str, float] = {}
        self.stopped: frozenset[str] = frozenset()
        """Actors stopped by a signal at the last check."""

    @property
    def held_up(self) -> dict[str, StepDelays]:
        """Delayed steps so far, by actor, with the current step; without the world, which paces the run."""
        found = dict(self._earlier_delays)
        if self._phase != "step":
            return found
        for suspect, times in self._times.items():
            # extrapolate to the time before the first two checks
            if times.watched_s and suspect.name not in ("", "world"):
                own = (times.idle_s + times.worked_s) / times.watched_s
                if (lasted_s := min(own, 1.0) * self._lasted_s) >= self._timeout.delayed_s:
                    found[suspect.name] = found.get(suspect.name, StepDelays()).plus_step(lasted_s)
        return found

    def step(self) -> None:
        """Reset the timers after a step, or after another awaited event."""
        now = self._clock()
        if self._times:
            self._advance_clock(now)
            self._earlier_delays = self.held_up
        self._checked_s = now
        self._times.clear()
        self._phase, self._lasted_s, self._next_notice_s = "step", 0.0, self.NOTICE_WAIT_S
        self.stopped = frozenset()
        for name, one in self._earlier_delays.items():
            if one.total_s >= self._next_notices.get(name, self.NOTICE_TOTAL_S):
                self._next_notices[name] = 2 * one.total_s
                self._notify(next(delay_sentences({name: one})))

    def activity(self, suspect: AwaitedProcess) -> str:
        """Return a suspect's activity at the last check, in words; "" before the first."""
        times = self._times.get(suspect)
        return times.activity if times else ""

    def check(
        self,
        everyone: Sequence[AwaitedProcess],
        awaited: Sequence[AwaitedProcess],
        what: str,
        phase: Phase = "step",
    ) -> Stall | None:
        """Return the process of `awaited` that exceeded its timeout, if any; `what`: the event awaited.

        `everyone`: all processes of the run; no stall is reported while one of them is stopped, or an awaited
        one is on an unreachable host.
        """
        now = self._clock()
        if now - self._checked_s < self._timeout.check_interval_s:
            return None
        elapsed_s = self._advance_clock(now)
        known = self._table()
        trees = {one.pid: process_table.descendants((one.pid,), known) for one in everyone}
        self._note_stopped({one.name for one in everyone if any(known[p].stopped for p in trees[one.pid])})
        # the awaited message may be in the world's process, which is the router
        link = {pid for one in everyone if one.name == "world" for pid in trees[one.pid]}
        self._phase = phase
        for suspect in awaited:
            tree = trees.get(suspect.pid, set())
            self._charge(suspect, {pid: known[pid] for pid in tree}, tree | link, elapsed_s)
        found = None
        if not self.stopped and all(self._times[one].activity != _UNREACHABLE_HOST for one in awaited):
            found = next((stall for one in awaited if (stall := self._find_stall(one, what))), None)
        if found is None and phase == "step" and self._lasted_s >= self._next_notice_s:
            self._next_notice_s *= 2
            named = [f"{one.name} {self.activity(one)}" for one in awaited[: self.MAX_NAMES]]
            more = [f"and {len(awaited) - len(named)} more"] if len(awaited) > len(named) else []
            self._notify(f"{what} for {self._lasted_s:.0f} s; {', '.join(named + more)}")
        return found

    def _note_stopped(self, stopped: Collection[str]) -> None:
        if stopped and stopped != self.stopped:
            self._notify(f"{', '.join(sorted(stopped))} stopped by a signal; the run waits for SIGCONT")
        self.stopped = frozenset(stopped)

    def _advance_clock(self, now: float) -> float:
        """Return the time to charge since the last check."""
        elapsed_s = min(now - self._checked_s, 2 * self._timeout.check_interval_s)
        self._checked_s = now
        self._lasted_s += elapsed_s
        return elapsed_s

    def _charge(
        self,
        suspect: AwaitedProcess,
        tree: Mapping[int, ProcessState],
        carriers: Collection[int],
        elapsed_s: float,
    ) -> None:
        queued = [waited for pid in carriers if (waited := self._queued(pid)) is not None]
        now = _ProcessTimes(
            math.fsum(one.cpu_s for one in tree.values()), math.fsum(queued) if queued else None
        )
        before = self._times.setdefault(suspect, now)
        worked_s, waited_s = max(now.cpu_s - before.cpu_s, 0.0), None
        if now.queued_s is not None and before.queued_s is not None:
            waited_s = max(now.queued_s - before.queued_s, 0.0)
        before.cpu_s, before.queued_s = now.cpu_s, now.queued_s
        working = worked_s >= self._timeout.working_share * elapsed_s
        before.activity = _activity(tree, working=working)
        if before is now or self.stopped:
            return
        before.watched_s += elapsed_s
        before.worked_s += worked_s
        if before.activity in (_ON_DISK, _UNREACHABLE_HOST):
            return
        if waited_s is not None:
            before.idle_s += max(elapsed_s - worked_s - waited_s, 0.0)
        elif not working and not any(one.state == "R" for one in tree.values()):
            before.idle_s += elapsed_s

    def _find_stall(self, suspect: AwaitedProcess, what: str) -> Stall | None:
        times = self._times[suspect]
        limit_s = self._timeout.step_s
        factor = self._timeout.start_factor if self._phase == "start" else 1.0
        idle_s, busy_s = times.idle_s, times.worked_s / factor
        if idle_s + busy_s < limit_s:
            return None
        if busy_s < _NEGLIGIBLE * limit_s:
            return Stall(suspect, f"{what} for {limit_s:g} s")
        if idle_s < _NEGLIGIBLE * limit_s:
            return Stall(suspect, f"{what} after {limit_s * factor:g} s of CPU time")
        lasted_s = idle_s + times.worked_s
        share = f"{times.worked_s:.0f} s of it CPU time"
        return Stall(suspect, f"{what} for {lasted_s:.0f} s, {share}")


_NEGLIGIBLE: Final = 0.2
"""Share of the time that is too small to be mentioned."""
_ON_DISK: Final = "is waiting for a disk"
_UNREACHABLE_HOST: Final = "is on an unreachable host"


def _activity(tree: Mapping[int, ProcessState], *, working: bool) -> str:
    """Return the activity of a process and its descendants, in words."""
    if any(one.stopped for one in tree.values()):
        return "is stopped"
    if any(one.state == UNREACHABLE for one in tree.values()):
        return _UNREACHABLE_HOST
    if working or any(one.state == "R" for one in tree.values()):
        return "is running or waiting for a processor"
    parents = {one.parent for one in tree.values()}
    asleep = [pid for pid, one in tree.items() if one.state == "D"]
    if any(pid not in parents for pid in asleep):
        return _ON_DISK
    # after vfork(2), a process sleeps as if for a disk until its child calls exec or exits
    return "is waiting for a child process" if asleep else "is idle"


_MB: Final = 1_000_000
_BLOCK: Final = 512
"""Block size of stat(2), bytes."""
_KEEPERS: Final = 2
"""Processes that isolation adds to a robot's own."""


class DiskUsage(NamedTuple):
    """Disk usage of a folder."""

    size: int
    """Bytes on disk, without holes in files."""
    files: int
    """Files, folders and links."""


class ResourceMonitor:
    """Periodic check of limits that the system does not enforce: a robot's folder, and its processes' sum."""

    INTERVAL_S: Final = 0.5
    """Interval of checks, s; own choice: time for a fast disk, or memory, to take 1 GB."""
    SHARE: Final = 2
    """Least delay of the next check, as a multiple of the last one's duration: robots with very many files
    must not slow down the run."""

    def __init__(self, limits: ProcessLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._next_s = clock() + self.INTERVAL_S

    def fault(self, children: Iterable[ChildProcess]) -> str | None:
        """Return a sentence on the first robot above its limits; None: no fault, or no check due."""
        began_s = self._clock()
        if began_s < self._next_s:
            return None
        robots = [child for child in children if child.program.module == "actors.robot"]
        known = process_table.processes() if robots else {}
        found = next((fault for child in robots if (fault := self._fault(child, known))), None)
        now_s = self._clock()
        self._next_s = now_s + max(self.INTERVAL_S, self.SHARE * (now_s - began_s))
        return found

    def _fault(self, child: ChildProcess, known: Mapping[int, ProcessState]) -> str | None:
        limits, folder = self._limits, child.program.log.parent
        disk = disk_usage(folder, limits.disk_mb * _MB, limits.disk_files)
        # its process, keeper and descendants, including reparented ones
        session = {pid for pid, one in known.items() if one.session == child.pid}
        members = process_table.descendants({child.pid, *session}, known)
        usages = [process_table.process_usage(pid) for pid in members]
        memory = math.fsum(one.memory for one in usages)
        threads = math.fsum(one.threads for one in usages)
        isolated = child.program.names is not None
        for exceeded, what, limit in (
            (
                disk.size > limits.disk_mb * _MB,
                f"written more than {limits.disk_mb} MB to {folder}",
                "disk_mb",
            ),
            (
                disk.files > limits.disk_files,
                f"created more than {limits.disk_files} files in {folder}",
                "disk_files",
            ),
            (
                memory > limits.memory_mb * _MB,
                f"used more than {limits.memory_mb} MB of memory in all its processes",
                "memory_mb",
            ),
            (
                isolated and threads > limits.processes + _KEEPERS,
                f"more than {limits.processes} processes and threads",
                "processes",
            ),
        ):
            if exceeded:
                return f"{child.program.actor} has {what}; raise the limit with --limit {limit}=N"
        return None


def disk_usage(folder: Path, most_size: int, most_files: int) -> DiskUsage:
    """Return the usage below `folder` without following links; stops counting above either limit."""
    size = files = 0
    folders = [str(folder)]
    while folders:
        with suppress(OSError), os.scandir(folders.pop()) as entries:  # the robot may remove or close it
            for entry in entries:
                files += 1
                with suppress(OSError):
                    size += entry.stat(follow_symlinks=False).st_blocks * _BLOCK
                if size > most_size or files > most_files:
                    return DiskUsage(size, files)
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
    return DiskUsage(size, files)
