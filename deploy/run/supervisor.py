"""Supervision of processes: start, stall detection, restart policy and end."""

import contextlib
import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress, Roster
from actors.processes.launcher import ChildProcess, Launcher, LaunchError, Program
from actors.processes.monitor import (
    AwaitedProcess,
    Phase,
    ResourceMonitor,
    StallDetector,
    Timeout,
)
from actors.processes.robot_logs import crash_line, current_line, last_line
from actors.runtime.codec import arrived
from actors.runtime.core import Bus
from actors.runtime.errors import AcrcError
from actors.runtime.failure import FailureNote, failure_sentence
from actors.runtime.process_table import leftover_fault, process_state
from actors.runtime.recording import RecordingError, decode_note

if TYPE_CHECKING:  # needs the cluster packages
    from deploy.hosts.run_hosts import HostedLauncher


class Supervisor:
    """Supervisor that starts processes and can end all of them."""

    POLL_S = 0.05
    """Period of supervision, and of stop commands of a suspended base, s; our choice."""
    GRACE_S = 3.0
    """Time for a process to exit after SIGTERM, s."""
    CONTINUES_STOPPED = True
    """True if `end_all` sends SIGCONT, so that stopped processes can exit in order before SIGKILL."""

    def __init__(
        self,
        launcher: "Launcher | HostedLauncher",
        say: Callable[[str], None] = lambda sentence: None,
        poll: Callable[[], None] = lambda: None,
    ) -> None:
        """`say`: prints a sentence for the user. `poll`: called while waiting."""
        self._launcher = launcher
        self._say = say
        self._poll = poll
        self._children: list[ChildProcess] = []

    @property
    def programs(self) -> tuple[Program, ...]:
        """All started programs, in order."""
        return tuple(child.program for child in self._children)

    @property
    def running(self) -> list[ChildProcess]:
        """Processes that have not exited."""
        return [child for child in self._children if child.exit_code is None]

    def start(self, programs: Iterable[Program]) -> None:
        """Start processes."""
        self._children.extend(self._launcher.start(program) for program in programs)

    def end_all(self) -> None:
        """Send SIGTERM to all processes, then SIGKILL."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            running = self.running
            for child in running:
                child.send(number)
                if self.CONTINUES_STOPPED:
                    child.send(signal.SIGCONT)
            self.await_exits(running)

    def await_exits(self, children: Iterable[ChildProcess]) -> None:
        """Wait until these processes have exited, at most GRACE_S."""
        deadline = time.monotonic() + self.GRACE_S
        remaining = [child for child in children if child.exit_code is None]
        while remaining and (time.monotonic() < deadline or self._launcher.arriving):
            with contextlib.suppress(LaunchError):  # its server's exit is reported elsewhere
                self._launcher.wait(self.POLL_S)
            self._poll()
            remaining = [child for child in remaining if child.exit_code is None]


def exit_description(child: ChildProcess) -> str:
    """Describe how a process has exited, with the last line of its log."""
    code, last = child.exit_code or 0, child.program.outside_text(last_line(child.program.log))
    outcome = f"by signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    return f"{outcome}{f': {last}' if last else ''}"


_CRASHES: Final = (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT)
"""Signals of crashes."""


def host_suffix(children: Iterable[ChildProcess], actor: str) -> str:
    """Return the actor's host as " (on host …)"; empty: this computer."""
    host = next((child.host for child in children if child.program.actor == actor), "")
    return f" (on host {host})" if host else ""


class RunSupervisor(Supervisor):
    """Supervisor of one run, which ends at the first failure or stall."""

    OBSERVER_GRACE_S: Final = 15.0
    """Time for the observer to finish its file after the run, s; then it is terminated."""

    def __init__(
        self,
        launcher: "Launcher | HostedLauncher",
        restart: Callable[[ProcessOrder, int], Program],
        on_progress: Callable[[Progress], None],
        timeout: Timeout,
        resources: ResourceMonitor,
        say: Callable[[str], None],
    ) -> None:
        """`restart`: returns the program of an ordered restart at a step."""
        super().__init__(launcher, say)
        self._restart = restart
        self._on_progress = on_progress
        self._resources = resources
        self.stalls = StallDetector(timeout, say, table=launcher.table, queued_s=launcher.queued_s)
        """Stalls and delays of the actors' steps."""
        self._complete: set[int] = set()
        """Ids of processes that have exited as planned."""
        self._recording_bytes = -1
        """Size of the world's recording, which grows with every step, bytes."""
        self._paused = self._finished = False
        self._waiting: Progress | None = None
        """Last report that the world awaits something in this step; None: it awaits nothing."""
        self.rosters = 0
        """Roster messages received."""

    @property
    def notes(self) -> dict[Path, Mapping[str, str]]:
        """Notes of each recording process, by path of its recording, once all have exited."""
        return {child.program.record: child.notes() for child in self._children if child.program.record}

    @property
    def cpu_s(self) -> float:
        """CPU time of all recording processes, once they have exited, s."""
        return sum(child.cpu_s for child in self._children if child.program.record)

    def watch(self, bus: Bus) -> None:
        """Wait until all processes have exited as planned. Raises AcrcError for the first that has not."""
        while any(child.program.record for child in self.running):
            self._launcher.wait(self.POLL_S)
            self._take_messages(bus)
            self.check_all()
        self._take_messages(bus)
        self.check()
        deadline = time.monotonic() + self.OBSERVER_GRACE_S
        while (running := self.running) and time.monotonic() < deadline:
            # processes stopped by a signal do not finish; `end_all` continues and terminates them
            if all((state := process_state(child.pid)) is not None and state.stopped for child in running):
                return
            self._launcher.wait(self.POLL_S)

    def await_file(self, path: Path, creator: str) -> bool:
        """Wait until the file exists; return False if `creator`, the actor that creates it, has exited."""
        while not path.exists():
            if not any(child.program.actor == creator for child in self.running):
                self.check()
                return False
            self._launcher.wait(0.005)
            self.check_all()
        return True

    def check_all(self) -> None:
        """Raise AcrcError if a process has failed, stalls the run or exceeds a limit."""
        self.check()
        running = [child for child in self.running if child.program.record]
        world = next(child for child in self._children if child.program.actor == "world")
        assert world.program.record is not None
        fault = self._stall_fault(running, world.program.record)
        fault = fault or self._resources.fault(child for child in running if not child.host)
        if fault is not None:
            self.check()  # a process that has just exited explains more
            raise AcrcError(fault)

    def check(self) -> None:
        """Raise AcrcError if a process has not exited as planned."""
        self._launcher.wait(0.0)
        exited = [child for child in self._children if child.exit_code is not None and child.program.record]
        failed = [child for child in exited if child.exit_code]
        if fault := self._launcher.fault():  # the cause of its robots' exits
            raise AcrcError(fault)
        if failed:
            raise AcrcError(_failure_cause(failed))
        for child in exited:
            if child.pid not in self._complete:
                self._complete.add(child.pid)
                _check_completion(child)

    def _stall_fault(self, running: Sequence[ChildProcess], recording: Path) -> str | None:
        """Describe the process that stalls the next step or the end; None if none does."""
        if self._finished:
            names = [child.program.actor for child in running]
            return self._timeout_fault(running, f"{', '.join(names)} did not end after the last step")
        size = recording.stat().st_size if recording.is_file() else 0
        if size != self._recording_bytes or self._paused:
            self._recording_bytes, self._waiting = size, None
            self.stalls.step()
            return None
        # without a report from the world, the world itself stalls
        activity, starting = "the world has not taken a step", not size
        names = ["world"]
        if self._waiting is not None:
            activity, starting = self._waiting.awaits, self._waiting.starting
            names = [*self._waiting.awaited] or names
        awaited = [child for child in running if child.program.actor in names]
        activity += host_suffix(running, names[0])
        return self._timeout_fault(running, activity, awaited, "start" if starting else "step")

    def _timeout_fault(
        self,
        running: Sequence[ChildProcess],
        activity: str,
        awaited: Sequence[ChildProcess] | None = None,
        phase: Phase = "end",
    ) -> str | None:
        """Describe which of `awaited` exceeds its timeout, with its current line.

        `activity`: what is overdue, as a clause. `awaited`: default: all of `running`.
        """
        processes = {child.pid: AwaitedProcess(child.program.actor, child.pid) for child in running}
        suspects = [processes[child.pid] for child in (running if awaited is None else awaited)]
        stall = self.stalls.check([*processes.values()], suspects, activity, phase)
        if stall is None:
            return None
        stalled_child = next(child for child in running if child.pid == stall.suspect.pid)
        place = current_line(stalled_child, self._launcher.wait)
        return f"{stall.sentence}; {stalled_child.program.actor} is at {place}" if place else stall.sentence

    def _take_messages(self, bus: Bus) -> None:
        for progress in arrived(bus, PROGRESS):
            self._paused, self._waiting = progress.paused, progress if progress.awaits else None
            if progress.finished and not self._finished:
                self._finished = True
                self.stalls.step()
            self._on_progress(progress)
        for roster in arrived(bus, ROSTER):
            self.rosters += 1
            self._restart_robots(roster)

    def _restart_robots(self, roster: Roster) -> None:
        for order in roster.start:
            self.stalls.step()
            while old := [child for child in self.running if child.program.actor == order.robot]:
                self._launcher.wait(self.POLL_S)
                self.check()
                if fault := self._timeout_fault(old, f"{order.robot} did not exit for its restart"):
                    raise AcrcError(fault)
            self.start([self._restart(order, roster.step)])


def _failure_cause(failed: list[ChildProcess]) -> str:
    """Describe the most informative failure: an actor's own error before its consequences."""
    notes = [note for note in (_failure_note(child) for child in failed) if note is not None]
    if notes:
        note = min(notes, key=lambda note: (not note.expected, note.actor == "world"))
        return failure_sentence(note) + host_suffix(failed, note.actor)
    child = failed[0]
    code = child.exit_code
    assert code is not None
    if code < 0:
        actor = child.program.actor
        sentence = f"{actor} was killed by {signal.Signals(-code).name}{host_suffix(failed, actor)}"
        place = crash_line(child.program.log) if -code in _CRASHES else ""
        return sentence + (f"; it was at {place}" if place else "")
    return f"{child.program.actor} ended {exit_description(child)}"


def _check_completion(child: ChildProcess) -> None:
    """Raise AcrcError if a process exited with code 0 before its end, or left processes running."""
    program = child.program
    if "final" not in child.notes():
        raise AcrcError(
            f"{program.actor} ended with exit code 0 during the run, as by os._exit(0); log: {program.log}"
        )
    if fault := leftover_fault(child.orphans > 0):
        raise AcrcError(f"{program.actor} failed: {fault}")


def _failure_note(child: ChildProcess) -> FailureNote | None:
    assert child.program.record is not None
    try:
        text = child.notes().get("failure")
        return None if text is None else decode_note(child.program.record, "failure", text, FailureNote)
    except RecordingError:
        return None
