"""Processes of a run: start, stall detection, the first failure, and the end of all of them."""

import contextlib
import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress, Roster
from actors.processes.launch import Child, Launcher, LaunchError, Program
from actors.processes.robot_logs import last_line, where_it_crashed, where_it_stands
from actors.processes.silence import (
    WORLD,
    HoldUp,
    ResourceWatch,
    Silence,
    SilenceVerdict,
    Suspect,
    Telling,
    Timeout,
)
from actors.runtime.codec import decode
from actors.runtime.core import Bus
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.failure import FailureNote, in_words
from actors.runtime.lifecycle.process_table import ProcessGlance, glance, leftover_fault
from actors.runtime.recording import RecordingError, decoded
from actors.topic import Message, Topic

if TYPE_CHECKING:  # it needs the packages of a cluster
    from deploy.hosts.run_hosts import HostedLauncher


def on_host(children: Iterable[Child], actor: str) -> str:
    """On which host it is, to stand behind what is said of it; empty: on this computer."""
    host = next((child.host for child in children if child.program.actor == actor), "")
    return f" (on host {host})" if host else ""


class Vigil:
    """What one run's processes are seen to do while no step is taken."""

    def __init__(
        self,
        timeout: Timeout,
        wait: Callable[[float], None],
        say: Callable[[str], None],
        table: Callable[[], Mapping[int, ProcessGlance]] = process_table.table,
        queued_s: Callable[[int], float | None] = process_table.queued_s,
    ) -> None:
        """`wait` passes so many seconds; `say` is told a sentence for the person at the terminal.

        `table` and `queued_s`: what is known of the run's processes, as of `process_table`.
        """
        self._silence = Silence(timeout, look=table, queued=queued_s)
        self._ends = Silence(timeout, look=table, queued=queued_s)
        self._wait = wait
        self._say = say
        self._size = -1
        self._waiting: Progress | None = None
        self._paused = False
        self._told: frozenset[str] = frozenset()
        self._telling = Telling(self._silence, say)

    @property
    def held_up(self) -> dict[str, HoldUp]:
        """Who has held up steps so far."""
        return self._silence.held_up

    def hear(self, progress: Progress) -> None:
        """Take in what the world says of itself."""
        self._paused = progress.paused
        self._waiting = progress if progress.awaits else None

    def look(self, running: Sequence[Child], recording: Path) -> str | None:
        """A sentence on who keeps the run from its next step for too long; None while all is well."""
        size = recording.stat().st_size if recording.is_file() else 0
        if size != self._size or self._paused:
            self._size = size
            self._waiting = None
            self._silence.broken()
            self._tell(frozenset())
            self._telling.broken()
            return None
        waiting = self._waiting
        if waiting is None:  # it says nothing, so it is to blame itself
            return self._ask(running, ("world",), WORLD, starting=not size)
        return self._ask(running, waiting.awaited or ("world",), waiting.awaits, starting=waiting.starting)

    def look_for_ends(self, running: Sequence[Child], what: str) -> str | None:
        """A sentence on who does not end for too long, although nothing is left to be done."""
        everyone = [Suspect(child.program.actor, child.pid) for child in running]
        verdict = self._ends.verdict(everyone, everyone, what)
        self._tell(self._ends.stopped)
        return None if verdict is None else self._words(verdict, running)

    def broken(self) -> None:
        """Somebody has done what was awaited."""
        self._silence.broken()
        self._ends.broken()

    def _ask(
        self, running: Sequence[Child], names: Sequence[str], what: str, starting: bool = False
    ) -> str | None:
        everyone = [Suspect(child.program.actor, child.pid) for child in running]
        awaited = [suspect for suspect in everyone if suspect.name in names]
        what += on_host(running, names[0])
        verdict = self._silence.verdict(everyone, awaited, what, starting=starting)
        self._tell(self._silence.stopped)
        if verdict is not None:
            return self._words(verdict, running)
        if not starting:
            self._telling.lasts(awaited, what)
        return None

    def _words(self, verdict: SilenceVerdict, running: Sequence[Child]) -> str:
        guilty = next(child for child in running if child.pid == verdict.suspect.pid)
        place = where_it_stands(guilty, self._wait)
        return f"{verdict.sentence}; {guilty.program.actor} stands at {place}" if place else verdict.sentence

    def _tell(self, stopped: frozenset[str]) -> None:
        if stopped != self._told:
            self._told = stopped
            if stopped:
                self._say(f"{', '.join(sorted(stopped))} stopped by a signal; the run waits for SIGCONT")


_CRASHES: Final = (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT)
"""Signals that a process brings upon itself."""


class Supervisor:
    """One run's processes. Ends with all of them gone, whatever happens."""

    POLL_S = 0.05
    GRACE_S = 3.0
    """How long a process may take to end after it was asked to."""
    VIEW_S = 15.0
    """How long an observer may take to finish its file once the run is over; then it is asked to end."""

    def __init__(
        self,
        launcher: "Launcher | HostedLauncher",
        restart: Callable[[ProcessOrder, int], Program],
        on_progress: Callable[[Progress], None],
        timeout: Timeout,
        resources: ResourceWatch,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        """`say` is told what the person at the terminal should know while the run goes on."""
        self._launcher = launcher
        self._restart = restart
        self._on_progress = on_progress
        self._resources = resources
        self._vigil = Vigil(timeout, launcher.wait, say, launcher.table, launcher.queued_s)
        self._children: list[Child] = []
        self._complete: set[int] = set()
        """Processes that have ended as planned, by id."""
        self._finished = False
        self.rosters = 0
        """Roster messages received."""

    @property
    def held_up(self) -> dict[str, HoldUp]:
        """Who has held up steps so far."""
        return self._vigil.held_up

    @property
    def programs(self) -> tuple[Program, ...]:
        """Every program that was started, in order."""
        return tuple(child.program for child in self._children)

    @property
    def notes(self) -> dict[Path, Mapping[str, str]]:
        """What each process that records has noted of itself, by its recording, once all have ended."""
        return {child.program.record: child.notes() for child in self._children if child.program.record}

    @property
    def cpu_s(self) -> float:
        """CPU time of all that record, once they have ended, s."""
        return sum(child.cpu_s for child in self._children if child.program.record)

    @property
    def running(self) -> bool:
        """True while at least one process has not ended."""
        return bool(self._running())

    def start(self, programs: Iterable[Program]) -> None:
        """Start processes."""
        self._children.extend(self._launcher.start(program) for program in programs)

    def watch(self, bus: Bus) -> None:
        """Stay until every process has ended as planned; AcrcError at the first that does not."""
        while any(child.program.record for child in self._running()):
            self._launcher.wait(self.POLL_S)
            self._take_messages(bus)
            self.look()
        self._take_messages(bus)
        self.check()
        deadline = time.monotonic() + self.VIEW_S
        while (running := self._running()) and time.monotonic() < deadline:
            # who is held by a signal finishes nothing; it is let go, and told to end, by `end_all`
            if all((seen := glance(child.pid)) is not None and seen.stopped for child in running):
                return
            self._launcher.wait(self.POLL_S)

    def await_file(self, path: Path, needed: str) -> bool:
        """Stay until a process has made the file, so that nobody has to try again and again.

        False if the process `needed`, which was to make it, has ended.
        """
        while not path.exists():
            if not any(child.program.actor == needed for child in self._running()):
                self.check()
                return False
            self._launcher.wait(0.005)
            self.look()
        return True

    def look(self) -> None:
        """AcrcError if a process has ended otherwise than planned, or keeps the run from going on."""
        self.check()
        running = [child for child in self._running() if child.program.record]
        world = next((child for child in self._children if child.program.actor == "world"), None)
        assert world is not None and world.program.record is not None
        if self._finished:
            fault = self._vigil.look_for_ends(running, f"{_names(running)} did not end after the last step")
        else:
            fault = self._vigil.look(running, world.program.record)
        fault = fault or self._resources.fault(child for child in running if not child.host)
        if fault is not None:
            self.check()  # what has just ended says more
            raise AcrcError(fault)

    def check(self) -> None:
        """AcrcError if a process has ended otherwise than planned."""
        self._launcher.wait(0.0)
        ended = [child for child in self._children if child.exit_code is not None and child.program.record]
        failed = [child for child in ended if child.exit_code]
        if fault := self._launcher.fault():  # its robots have ended only because of that
            raise AcrcError(fault)
        if failed:
            raise AcrcError(_cause(failed))
        for child in ended:
            if child.pid not in self._complete:
                self._complete.add(child.pid)
                _check_end(child)

    def end_all(self) -> None:
        """Ask every process to end, then make it."""
        for number, grace_s in ((signal.SIGTERM, self.GRACE_S), (signal.SIGKILL, self.GRACE_S)):
            for child in self._running():
                child.send(number)
                child.send(signal.SIGCONT)  # one that is stopped would not hear it
            deadline = time.monotonic() + grace_s
            while self._running() and (time.monotonic() < deadline or self._launcher.arriving):
                with contextlib.suppress(
                    LaunchError
                ):  # the server's end was told before, or is of no interest
                    self._launcher.wait(self.POLL_S)

    def _running(self) -> list[Child]:
        return [child for child in self._children if child.exit_code is None]

    def _take_messages(self, bus: Bus) -> None:
        while (progress := _next(bus, PROGRESS)) is not None:
            assert isinstance(progress, Progress)
            self._vigil.hear(progress)
            if progress.finished and not self._finished:
                self._finished = True
                self._vigil.broken()
            self._on_progress(progress)
        while (roster := _next(bus, ROSTER)) is not None:
            assert isinstance(roster, Roster)
            self.rosters += 1
            self._restart_robots(roster)

    def _restart_robots(self, roster: Roster) -> None:
        for order in roster.start:
            self._vigil.broken()
            while old := [child for child in self._running() if child.program.actor == order.robot]:
                self._launcher.wait(self.POLL_S)
                self.check()
                if fault := self._vigil.look_for_ends(old, f"{order.robot} did not end when it was to"):
                    raise AcrcError(fault)
            self.start([self._restart(order, roster.step)])


def _next(bus: Bus, topic: Topic[Progress] | Topic[Roster]) -> Message | None:
    delivery = bus.poll(topic)  # type: ignore[arg-type]
    return None if delivery is None else decode(delivery.topic, delivery.key, delivery.payload)


def _cause(failed: list[Child]) -> str:
    """One sentence on what failed first: an actor with a cause of its own before those it dragged down."""
    notes = [note for note in (_failure(child) for child in failed) if note is not None]
    if notes:
        note = min(notes, key=lambda note: (not note.expected, note.actor == "world"))
        return in_words(note) + on_host(failed, note.actor)
    child = failed[0]
    code = child.exit_code
    assert code is not None
    if code < 0:
        actor = child.program.actor
        ended = f"{actor} was ended by signal {signal.Signals(-code).name}{on_host(failed, actor)}"
        place = where_it_crashed(child.program.log) if -code in _CRASHES else ""
        return ended + (f"; it stood at {place}" if place else "")
    last = child.program.in_our_words(last_line(child.program.log))
    return f"{child.program.actor} ended with exit code {code}" + (f": {last}" if last else "")


def _check_end(child: Child) -> None:
    """AcrcError if a process with exit code 0 has ended before its time, or left something running."""
    program = child.program
    if "final" not in child.notes():
        raise AcrcError(
            f"{program.actor} ended with exit code 0 in the middle of the run, as by os._exit(0); "
            f"its log is {program.log}"
        )
    if wrong := leftover_fault(child.strays > 0):
        raise AcrcError(f"{program.actor} failed: {wrong}")


def _names(children: Iterable[Child]) -> str:
    return ", ".join(child.program.actor for child in children)


def _failure(child: Child) -> FailureNote | None:
    assert child.program.record is not None
    try:
        text = child.notes().get("failure")
        return None if text is None else decoded(child.program.record, "failure", text, FailureNote)
    except RecordingError:
        return None
