"""What is changed where a branch leaves its run: read from the command line, and brought among the orders."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType

from actors.installation.usage import OptionError, wrong_value
from actors.instant import seconds
from actors.messages import CONTROL, Control
from actors.orders import Order, Pause, Resume, Speed, Step, Stop
from actors.robot.behaviour import Setting, succession
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from deploy.run import orders
from observation.replay.recorded_orders import TimedControl


@dataclass(frozen=True)
class BranchEvent:
    """An order that the run was not given."""

    order: Order
    at_s: float
    words: str
    """As it was typed, without the instant."""


@dataclass(frozen=True)
class Omission:
    """Something that was ordered in the run, and is not ordered in the branch."""

    words: str
    """What there is not then, as in `r2 dead`."""
    orders: tuple[tuple[int, Order], ...]
    """By the steps at whose beginning they were taken, the first one first; those that undo it included."""


@dataclass(frozen=True)
class Change:
    """Where a branch leaves its run, and how."""

    at_s: float
    strategy: str | None = None
    """Decides from there on; None: whichever did."""
    settings: Mapping[str, Setting] = field(default_factory=lambda: MappingProxyType({}))
    """Of the strategy from there on: where they differ from what they were, or another one has."""
    events: tuple[BranchEvent, ...] = ()
    """In the order in which they were given."""
    without: Omission | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """What is changed, for people."""
        from_then = f"from {self.at_s:g} s on"
        changed = () if self.strategy is None else (f"strategy {self.strategy} {from_then}",)
        settings = tuple(f"strategy.{name}={value} {from_then}" for name, value in self.settings.items())
        return (*changed, *settings, *self.events_words)

    @property
    def events_words(self) -> tuple[str, ...]:
        """The same of what is ordered alone."""
        omitted = () if self.without is None else (f"without {self.without.words}",)
        return (*omitted, *(f"{event.words} at {event.at_s:g} s" for event in self.events))


def place(text: str) -> tuple[Path, float]:
    """The folder and the instant, s, that a text such as `runs/seen@120` means. Raises OptionError."""
    folder, _, instant = text.rpartition("@")
    at_s = succession.instant_of(instant)
    if not folder or at_s is None:
        raise wrong_value("branch", text, "a run's folder and an instant above 0 in s, such as runs/seen@120")
    return Path(folder), at_s


def event(text: str, branch_s: float) -> BranchEvent:
    """The event that a text such as `kill r2 at 130` means; without instant, at that of the branch.

    Raises OptionError for words that are no order, and for an instant before the branch.
    """
    words, at_s = text.split(), branch_s
    if "at" in words[-2:-1]:
        given = succession.instant_of(words[-1])
        if given is None or given < branch_s:
            raise wrong_value("--event", text, f"an order, and at its end an instant from {branch_s:g} s on")
        words, at_s = words[:-2], given
    if not words:
        raise wrong_value("--event", text, "an order as of `acrc order`, such as kill r2 at 130")
    try:
        order = orders.parse(words[0], words[1:])
    except OptionError as error:
        raise OptionError(f"--event: {error}") from None
    if isinstance(order, Pause | Resume | Step | Speed | Stop):
        raise wrong_value("--event", text, "an order that changes what happens; pause, speed and stop do not")
    return BranchEvent(order, at_s, " ".join(words))


def with_events(
    recorded: Iterable[TimedControl], events: Sequence[BranchEvent], step_us: int
) -> list[TimedControl]:
    """All orders in the order of their boundaries; an event comes before what the run was given there.

    The world takes one message at a boundary, so there it becomes part of the first one.
    """
    own = {step: list(group) for step, group in groupby(_by_step(events, step_us), key=attrgetter("step"))}
    given: list[TimedControl] = []
    for taken in recorded:
        control = taken
        for step in [step for step in own if step <= taken.step]:
            orders_there = tuple(one.order for one in own.pop(step))
            if step == taken.step:
                told = decode(at(CONTROL).topic, CONTROL.key(), taken.payload)
                assert isinstance(told, Control)
                control = TimedControl(step, _encoded((*orders_there, *told.orders), told.ticket))
            else:
                given.append(TimedControl(step, _encoded(orders_there)))
        given.append(control)
    given += [TimedControl(step, _encoded(tuple(one.order for one in group))) for step, group in own.items()]
    return given


def without(recorded: Iterable[TimedControl], gone: Sequence[tuple[int, Order]]) -> Iterator[TimedControl]:
    """The orders that a run was given, but for some."""
    for taken in recorded:
        told = decode(at(CONTROL).topic, CONTROL.key(), taken.payload)
        assert isinstance(told, Control)
        kept = tuple(order for order in told.orders if (taken.step, order) not in gone)
        yield taken if kept == told.orders else TimedControl(taken.step, _encoded(kept, told.ticket))


@dataclass(frozen=True)
class _Boundary:
    step: int
    order: Order


def boundary(at_s: float, step_us: int) -> int:
    """The first step that does not begin before the instant."""
    return -(-seconds(at_s) // step_us)


def _by_step(events: Sequence[BranchEvent], step_us: int) -> list[_Boundary]:
    there = [_Boundary(boundary(one.at_s, step_us), one.order) for one in events]
    return sorted(there, key=attrgetter("step"))


def _encoded(given: tuple[Order, ...], ticket: str = "") -> bytes:
    return encode(Control(0, given, ticket), CONTROL.key())
