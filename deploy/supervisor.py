"""Watches over the processes of a run: starts them, notices the first that fails, and ends them all."""

import signal
import time
from collections.abc import Callable, Iterable

from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress, Roster
from actors.runtime.bus import Bus
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.process import FailureNote
from actors.runtime.recording import RecordingError, decoded, read_notes
from actors.topic import Message, Topic
from deploy.launch import Child, Launcher, Program


class RunFailedError(AcrcError):
    """An actor died, hung or raised; the sentence names it and the cause."""


class Supervisor:
    """One run's processes. Ends with all of them gone, whatever happens."""

    POLL_S = 0.05
    GRACE_S = 3.0
    """How long a process may take to end after it was asked to."""
    FAREWELL_S = 20.0
    """How long the processes may take to close their files after the last step."""

    def __init__(
        self,
        launcher: Launcher,
        restart: Callable[[ProcessOrder, int], Program],
        on_progress: Callable[[Progress], None],
        silence_s: float,
    ) -> None:
        """`silence_s`: how long the world may take no step, s."""
        self._launcher = launcher
        self._restart = restart
        self._on_progress = on_progress
        self._silence_s = silence_s
        self._children: list[Child] = []
        self._finished_at: float | None = None
        self._paused = False
        self._grown = (0, time.monotonic())
        self.rosters = 0
        """Roster messages received."""

    @property
    def programs(self) -> tuple[Program, ...]:
        """Every program that was started, in order."""
        return tuple(child.program for child in self._children)

    @property
    def running(self) -> bool:
        """True while at least one process has not ended."""
        return bool(self._running())

    def start(self, programs: Iterable[Program]) -> None:
        """Start processes."""
        self._children.extend(self._launcher.start(program) for program in programs)

    def watch(self, bus: Bus) -> None:
        """Stay until every process has ended as planned; RunFailedError at the first that does not."""
        while self._running():
            self._launcher.wait(self.POLL_S)
            self.check()
            self._take_messages(bus)
            self._watch_world()
            if self._finished_at and time.monotonic() > self._finished_at + self.FAREWELL_S:
                names = ", ".join(child.program.actor for child in self._running())
                raise RunFailedError(f"{names} did not end within {self.FAREWELL_S:g} s of the last step")
        self._take_messages(bus)

    def check(self) -> None:
        """RunFailedError if a process has ended otherwise than planned."""
        self._launcher.wait(0.0)
        failed = [
            child
            for child in self._children
            if child.exit_code not in (None, 0) and child.program.record is not None
        ]
        if failed:
            raise RunFailedError(_cause(failed))

    def _watch_world(self) -> None:
        """RunFailedError if the world, which watches all others, has itself written nothing for too long."""
        world = next(
            (child.program.record for child in self._running() if child.program.actor == "world"), None
        )
        if world is None or not world.exists():
            return
        size, since = world.stat().st_size, self._grown[1]
        if size != self._grown[0] or self._paused:
            self._grown = (size, time.monotonic())
        elif time.monotonic() > since + self._silence_s:
            raise RunFailedError(f"the world has not taken a step for {self._silence_s:g} s")

    def end_all(self) -> None:
        """Ask every process to end, then make it."""
        for number, patience_s in ((signal.SIGTERM, self.GRACE_S), (signal.SIGKILL, self.GRACE_S)):
            for child in self._running():
                child.send(number)
            deadline = time.monotonic() + patience_s
            while self._running() and time.monotonic() < deadline:
                self._launcher.wait(self.POLL_S)

    def _running(self) -> list[Child]:
        return [child for child in self._children if child.exit_code is None]

    def _take_messages(self, bus: Bus) -> None:
        while (progress := _next(bus, PROGRESS)) is not None:
            assert isinstance(progress, Progress)
            self._paused = progress.paused
            if progress.finished:
                self._finished_at = time.monotonic()
            self._on_progress(progress)
        while (roster := _next(bus, ROSTER)) is not None:
            assert isinstance(roster, Roster)
            self.rosters += 1
            self._restart_robots(roster)

    def _restart_robots(self, roster: Roster) -> None:
        for order in roster.start:
            deadline = time.monotonic() + self.FAREWELL_S
            while any(child.program.actor == order.robot for child in self._running()):
                self._launcher.wait(self.POLL_S)
                if time.monotonic() > deadline:
                    raise RunFailedError(
                        f"{order.robot} did not end within {self.FAREWELL_S:g} s of its kill"
                    )
            self.start([self._restart(order, roster.step)])


def _next(bus: Bus, topic: Topic[Progress] | Topic[Roster]) -> Message | None:
    delivery = bus.poll(topic)  # type: ignore[arg-type]
    return None if delivery is None else decode(delivery.topic, delivery.key, delivery.payload)


def _cause(failed: list[Child]) -> str:
    """One sentence on what failed first: an actor with a cause of its own before those it dragged down."""
    notes = [note for note in (_failure(child.program) for child in failed) if note is not None]
    if notes:
        note = min(notes, key=lambda note: (not note.expected, note.actor == "world"))
        where = "" if note.cause.startswith("step ") else f"{note.actor} failed in step {note.step}: "
        return f"{where}{note.cause}"
    child = failed[0]
    code = child.exit_code
    assert code is not None
    if code < 0:
        return f"{child.program.actor} was ended by signal {signal.Signals(-code).name}"
    last = _last_line(child.program)
    return f"{child.program.actor} ended with exit code {code}" + (f": {last}" if last else "")


def _failure(program: Program) -> FailureNote | None:
    assert program.record is not None
    try:
        text = read_notes(program.record).get("failure")
        return None if text is None else decoded(program.record, "failure", text, FailureNote)
    except RecordingError:
        return None


def _last_line(program: Program) -> str:
    lines = program.log.read_text(errors="replace").split("\n") if program.log.is_file() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
