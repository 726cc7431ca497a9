"""What a process does in some of its steps, span by span: waiting for what, taking, advancing, sending.

For whoever asks for it in the process's set-up. Only the shell is measured, from outside of the core, and
what it does stays the same; a process that is not asked has none of this around it.
"""

import time
from collections.abc import Callable, Sequence
from typing import Annotated, Final, Literal, NamedTuple

import msgspec

from actors.runtime.bus_interface import Bus, Delivery, Outlet
from actors.runtime.core import Address, Core, Inputs, Output
from actors.runtime.recording import Journal
from actors.runtime.shell import Shell
from actors.topic import Message, Topic

NOTE: Final = "spans"
"""Name of the record in the process's recording: the one file that a robot's process, shut off, may write."""
Whole = Annotated[int, msgspec.Meta(ge=0, le=1 << 62)]
Kind = Literal["wait", "take", "advance", "send", "record"]
"""wait: for a message; take: it is kept, decoded, counted, recorded; advance: the core; send: encoded,
counted, recorded, put on the mesh; record: the recording is handed to the operating system."""


class Window(NamedTuple):
    """Consecutive steps."""

    first: int
    steps: int

    def __contains__(self, step: object) -> bool:
        return isinstance(step, int) and self.first <= step < self.first + self.steps


class Span(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """What a process's main thread did from one instant to another; one span begins where the last ended."""

    kind: Kind
    step: Whole
    begin_ns: Whole
    """CLOCK_MONOTONIC, which all processes of a computer share."""
    end_ns: Whole
    thread_ns: Whole
    """CPU of the main thread meanwhile."""
    process_ns: Whole
    """CPU of the whole process, its mesh's thread included."""
    key: str = ""
    """Of the message that has come (wait) or gone (send)."""
    number: Whole = 0
    """Which of its sender's messages on that key it was, from 1 on."""
    missing: str = ""
    """The key that was waited for; the message that has come may be another of its topic."""


class SpansNote(msgspec.Struct, frozen=True):
    """The record."""

    actor: str
    spans: tuple[Span, ...]


class Stopwatch:
    """Tells spans apart: each lasts from the end of the one before."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._last = _now()
        self.step = 0
        """The step that the process is in."""
        self.sending = False
        """True from the end of an advance until all that it gave has been sent."""
        self.spans: list[Span] = []

    def end(self, kind: Kind, key: str = "", number: int = 0, missing: str = "") -> None:
        """The span that ends now; kept if its step is in the window."""
        before, now = self._last, _now()
        self._last = now
        if self.step in self._window:
            (begin, thread, process), (end, thread_now, process_now) = before, now
            cpu = thread_now - thread, process_now - process
            self.spans.append(Span(kind, self.step, begin, end, *cpu, key, number, missing))


class WatchedShell(Shell):
    """A shell whose turns are told apart; what a signal has it send is part of whatever that cut into."""

    def __init__(
        self,
        window: Window,
        core: Core,
        outlet: Outlet,
        journal: Journal,
        *,
        actor: str,
        open_to: Callable[[], Sequence[Address]] = tuple,
    ) -> None:
        self._watch = Stopwatch(window)
        super().__init__(_WatchedCore(core, self._watch), outlet, journal, actor=actor, open_to=open_to)

    def beside(self, bus: Bus) -> Bus:
        """The bus to drive this shell on, at which its waiting is told apart."""
        return _WatchedBus(bus, self, self._watch)

    def spans(self) -> SpansNote:
        """Those of the window, in their order."""
        return SpansNote(self.actor, tuple(self._watch.spans))

    def send(self, output: Output) -> None:
        """As any shell's."""
        super().send(output)
        if self._watch.sending:
            key = output.address.key
            self._watch.end("send", key, self.tally.sent.get(key, 0))

    def _advance(self) -> None:
        super()._advance()
        self._watch.sending = False
        self._watch.end("record")
        self._watch.step = self.core.step


class _WatchedCore:
    """A core that is told nothing of it."""

    def __init__(self, core: Core, watch: Stopwatch) -> None:
        self._core = core
        self._watch = watch
        self.missing = core.missing

    @property
    def step(self) -> int:
        return self._core.step

    @property
    def finished(self) -> bool:
        return self._core.finished

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        self._watch.step = self._core.step
        self._watch.end("take")
        outputs = self._core.advance(inputs)
        self._watch.end("advance")
        self._watch.sending = True
        return outputs


class _WatchedBus:
    """A bus that notes how long was waited for what."""

    def __init__(self, bus: Bus, shell: Shell, watch: Stopwatch) -> None:
        self._bus = bus
        self._shell = shell
        self._watch = watch
        self.publish = bus.publish
        self.poll = bus.poll

    def receive(self, topic: Topic[Message]) -> Delivery:
        missing = self._shell.awaited[0].key
        self._watch.end("take")
        delivery = self._bus.receive(topic)
        before = self._shell.tally.arrived.get(delivery.key, 0)
        self._watch.end("wait", delivery.key, before + 1, missing)
        return delivery


def _now() -> tuple[int, int, int]:
    return time.monotonic_ns(), time.thread_time_ns(), time.process_time_ns()
