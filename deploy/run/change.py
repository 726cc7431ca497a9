"""Change of a branch: strategy, settings and events from the command line.

A changed setting restarts the behaviour, which loses its state. Such a branch is therefore also compared with
a control run: the same strategy, restarted at the same instant with its old settings.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from actors.installation.usage import OptionError, wrong_value
from actors.instant import seconds
from actors.messages import AIRED, CONTROL, RADIO_READY, TRUTH, Control, Truth
from actors.orders import Order, Pause, Resume, Speed, Step, Stop
from actors.robot.behaviour import Setting, handover
from actors.robot.behaviour.handover import BehaviourChange
from actors.runtime.codec import decode, encode
from actors.runtime.core import Delivery, at
from actors.runtime.recording import Note, read_recording
from actors.runtime.shell import MemoryBus
from cleaning.strategies import entry
from deploy.run import order_bus
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario

_STRATEGY_PREFIX: Final = "strategy."


@dataclass(frozen=True)
class BranchEvent:
    """An additional order of a branch."""

    order: Order
    at_s: float
    words: str
    """The order as typed, without its instant."""


@dataclass(frozen=True)
class Change:
    """Instant and content of a branch's change."""

    at_s: float
    strategy: str | None = None
    """Strategy from `at_s` on; None: unchanged."""
    settings: Mapping[str, Setting] = field(default_factory=lambda: MappingProxyType({}))
    """Settings from `at_s` on: changed ones of the present strategy, or those of the new one."""
    events: tuple[BranchEvent, ...] = ()
    """Additional orders, in order of the command line."""

    @property
    def words(self) -> tuple[str, ...]:
        """Changes, as text."""
        from_then = f"from {self.at_s:g} s on"
        strategy = () if self.strategy is None else (f"strategy {self.strategy} {from_then}",)
        settings = tuple(f"strategy.{name}={value} {from_then}" for name, value in self.settings.items())
        events = (f"{event.words} at {event.at_s:g} s" for event in self.events)
        return (*strategy, *settings, *events)


def parse_branch_point(text: str) -> tuple[Path, float]:
    """Parse a folder and an instant, s, such as `runs/seen@120`. Raises OptionError."""
    folder, _, instant = text.rpartition("@")
    at_s = handover.instant_of(instant)
    if not folder or at_s is None:
        raise wrong_value("branch", text, "a run's folder and a time above 0 s, such as runs/seen@120")
    return Path(folder), at_s


def parse_event(text: str, branch_s: float) -> BranchEvent:
    """Parse an event such as `kill r2 at 130`; default instant: that of the branch.

    Raises OptionError for an invalid order or an instant before the branch.
    """
    words, at_s = text.split(), branch_s
    if "at" in words[-2:-1]:
        event_s = handover.instant_of(words[-1])
        if event_s is None or event_s < branch_s:
            raise wrong_value("--event", text, f"an order ending with a time of at least {branch_s:g} s")
        words, at_s = words[:-2], event_s
    if not words:
        raise wrong_value("--event", text, "an order of `acrc order`, such as kill r2 at 130")
    try:
        order = order_bus.parse(words[0], words[1:])
    except OptionError as error:
        raise OptionError(f"--event: {error}") from None
    if isinstance(order, Pause | Resume | Step | Speed | Stop):
        raise wrong_value(
            "--event", text, "an order that changes the run, not pause, resume, step, speed or stop"
        )
    return BranchEvent(order, at_s, " ".join(words))


class TimedControl(NamedTuple):
    """An encoded Control and the step at whose start it is applied."""

    step: int
    payload: bytes


def merge_events(
    recorded: Iterable[TimedControl], events: Sequence[BranchEvent], step_us: int
) -> list[TimedControl]:
    """Merge recorded orders and events, sorted by step; events come first within a step.

    The world accepts one message per step, so an event is merged into the first one.
    """
    added: dict[int, tuple[Order, ...]] = {}
    for event in events:
        step = first_step_at(event.at_s, step_us)
        added[step] = (*added.get(step, ()), event.order)
    merged: list[TimedControl] = []
    for step, payload in recorded:
        if step in added:
            control = decode(at(CONTROL).topic, CONTROL.key(), payload)
            assert isinstance(control, Control)
            merged.append(
                TimedControl(step, _encode_control((*added.pop(step), *control.orders), control.ticket))
            )
        else:
            merged.append(TimedControl(step, payload))
    merged += [TimedControl(step, _encode_control(orders)) for step, orders in added.items()]
    return sorted(merged, key=attrgetter("step"))


def first_step_at(at_s: float, step_us: int) -> int:
    """Return the first step that begins at or after the instant."""
    return -(-seconds(at_s) // step_us)


def _encode_control(orders: tuple[Order, ...], ticket: str = "") -> bytes:
    return encode(Control(0, orders, ticket), CONTROL.key())


def strategy_settings(settings: Iterable[tuple[str, Any]], file: Path) -> Mapping[str, Setting]:
    """Return the strategy's settings from the command line, by name.

    Other keys must have the run's values, as in its scenario `file`. Raises OptionError, and AcrcError for an
    invalid key or value.
    """
    found: dict[str, Setting] = {}
    for key, value in settings:
        if key.startswith(_STRATEGY_PREFIX) and key != _STRATEGY_PREFIX:
            found[key.removeprefix(_STRATEGY_PREFIX)] = value
        elif _actor_setups(load_scenario(file, Overrides(settings=((key, value),)))) != _actor_setups(
            load_scenario(file)
        ):
            raise wrong_value("--set", key, "strategy.NAME with --from, or the run's own value")
    return found


def _actor_setups(scenario: Scenario) -> tuple[object, ...]:
    """Return the set-ups of all actors."""
    resolved = resolve(scenario)
    return resolved.world, resolved.radio, resolved.behaviour, resolved.adaptation, resolved.stack


def branch_scenario(scenario: Scenario, change: Change) -> Scenario:
    """Return the branch's scenario: another strategy or other settings from `change.at_s` on."""
    present = _current_behaviour(scenario, change)
    settings = change.settings if change.strategy else {**present.settings, **change.settings}
    return _with_behaviour_change(
        scenario, BehaviourChange(change.at_s, change.strategy or present.name, settings)
    )


def control_scenario(scenario: Scenario, change: Change) -> Scenario | None:
    """Return the control run's scenario: the strategy restarted with its old settings.

    None if the branch has another strategy.
    """
    present = _current_behaviour(scenario, change)
    if change.strategy is not None and entry(change.strategy) != entry(present.name):
        return None
    return _with_behaviour_change(scenario, BehaviourChange(change.at_s, present.name, present.settings))


def _current_behaviour(scenario: Scenario, change: Change) -> BehaviourChange:
    """Return the strategy and settings that are active just before the branch."""
    first, handovers = handover.split(scenario.run.strategy)
    return [
        BehaviourChange(0.0, first, scenario.strategy),
        *(one for one in handovers if one.at_s < change.at_s),
    ][-1]


def _with_behaviour_change(scenario: Scenario, behaviour_change: BehaviourChange) -> Scenario:
    first, handovers = handover.split(scenario.run.strategy)
    strategy = handover.join(
        first, [*(one for one in handovers if one.at_s < behaviour_change.at_s), behaviour_change]
    )
    return replace(scenario, run=replace(scenario.run, strategy=strategy))


class OrderReplayBus(MemoryBus):
    """A bus that publishes recorded orders, sorted by step, each before its step begins."""

    def __init__(self, orders: Iterable[TimedControl]) -> None:
        super().__init__()
        self.orders_published = 0
        """Number of messages published so far."""
        self._pending = deque(orders)
        self.listen(at(RADIO_READY), lambda _: self._publish_until(0))
        self.listen(at(TRUTH), self._on_truth)

    def _on_truth(self, delivery: Delivery) -> None:
        """Publish the next step's orders once the world has finished a step."""
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        self._publish_until(truth.step + 1)

    def _publish_until(self, step: int) -> None:
        while self._pending and self._pending[0].step <= step:
            self.publish(CONTROL.pattern, self._pending.popleft().payload)
            self.orders_published += 1


def recorded_orders(world: Path) -> Iterator[TimedControl]:
    """Yield the external orders in the world's recording; each follows the last RadioAdvanced."""
    step = 0
    for item in read_recording(world):
        if isinstance(item, Note) or item.direction != "in":
            continue
        if item.key == AIRED.pattern:
            step = item.step + 1
        elif item.key == CONTROL.pattern:
            assert item.payload is not None, "the receiver of a message keeps it in full"
            yield TimedControl(step, item.payload)
