"""A radio core with robots at given places and frames at given instants."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from actors.messages import (
    AIRED,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    FrameOutcomes,
    Jam,
    Loss,
    OutgoingFrame,
    RadioAdvanced,
    RadioEvent,
    RadioEvents,
    RobotTruth,
    Transmit,
    Truth,
)
from actors.radio.core import RadioCore
from actors.radio.medium.state import Cca, PhyParameters, Transceiver
from actors.radio.propagation import IndoorPropagation, line_of_sight
from actors.radio.radio_model import RadioModel, RadioParameters
from actors.topic import Message

STEP = 100_000
TURNAROUND = 192
"""Turnaround between sending and receiving, µs."""
SPACING = 640
"""Spacing after a frame of more than 18 octets, µs."""
PLAIN = RadioParameters(
    Transceiver(0, tx_power_dbm=-32.6, cca=Cca.NEVER, min_be=0), PhyParameters(noise_dbm=-120.0)
)
"""Without channel assessment and noise, so that a frame begins exactly one turnaround after its request."""
REACH = line_of_sight(
    PLAIN.transceiver.tx_power_dbm - PLAIN.transceiver.sensitivity_dbm, PLAIN.propagation.path_loss
)
"""Range, 10.5 m."""


def around(parameters: RadioParameters = PLAIN) -> RadioModel:
    return RadioModel(parameters, IndoorPropagation(parameters.propagation), ())


@dataclass(frozen=True)
class Robot:
    """A robot in Truth, without its frames."""

    x: float
    y: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    stepping: bool = True
    powered: bool = True
    epoch: int = 0


@dataclass(frozen=True)
class Frame:
    instant: int
    robot: str
    tag: int = 0
    data: bytes = b"12345678901"

    @property
    def airtime(self) -> int:
        """Air time; default 20 octets: 52 symbols of 16 µs, 832 µs."""
        return (12 + 2 * (len(self.data) + 9)) * 16

    @property
    def end(self) -> int:
        """Its end on an idle medium with an empty queue."""
        return self.instant + TURNAROUND + self.airtime


@dataclass
class Swarm:
    """The core, the robots by id, and their events."""

    robots: dict[str, Robot]
    step_us: int = STEP
    model: RadioModel = field(default_factory=around)
    given: dict[str, list[RadioEvent]] = field(default_factory=dict)
    steps: list[dict[str, list[RadioEvent]]] = field(default_factory=list)
    records_outcomes: bool = False
    recorded: list[FrameOutcomes] = field(default_factory=list)

    def __post_init__(self) -> None:
        addresses = [(robot, 100 + number) for number, robot in enumerate(self.robots)]
        self.core = RadioCore(
            addresses, self.step_us, self.model, seed=1, records_outcomes=self.records_outcomes
        )

    def change(self, robot: str, **changes: Any) -> None:
        self.robots[robot] = replace(self.robots[robot], **changes)

    def truth(self, frames: Iterable[Frame], jams: Sequence[Jam] = (), losses: Sequence[Loss] = ()) -> Truth:
        sent = [frame.robot for frame in frames]
        robots = tuple(
            RobotTruth(i, r.x, r.y, 0.0, r.vx, r.vy, 0.0, r.stepping, r.powered, sent.count(i), r.epoch)
            for i, r in self.robots.items()
        )
        return Truth(self.core.step, self.core.step * self.step_us, robots, tuple(jams), losses=tuple(losses))

    def run(
        self, frames: Sequence[Frame] = (), jams: Sequence[Jam] = (), losses: Sequence[Loss] = ()
    ) -> dict[str, list[RadioEvent]]:
        """Run one step with these frames, and check the barrier's counts."""
        step = self.core.step
        have: dict[str, Message] = {}
        assert [address.key for address in self.core.missing(have)] == [TRUTH.key()]
        have[TRUTH.key()] = self.truth(frames, jams, losses)
        senders = [i for i, r in self.robots.items() if r.stepping and any(f.robot == i for f in frames)]
        assert [address.key for address in self.core.missing(have)] == [TRANSMIT.key(i) for i in senders]
        for robot in senders:
            mine = tuple(OutgoingFrame(f.tag, f.instant, f.data) for f in frames if f.robot == robot)
            have[TRANSMIT.key(robot)] = Transmit(step, mine)
        assert self.core.missing(have) == []
        outputs = self.core.advance(have)
        assert self.core.step == step + 1
        aired = outputs[-1].message
        assert (
            outputs[-1].address.key == AIRED.key() and isinstance(aired, RadioAdvanced) and aired.step == step
        )
        events: dict[str, list[RadioEvent]] = {}
        for output in outputs[:-1]:
            address, message = output.address, output.message
            if isinstance(message, FrameOutcomes):
                self.recorded.append(message)
                continue
            assert address.topic is RECEIVED and isinstance(message, RadioEvents) and message.step == step + 1
            events[address.robot] = list(message.events)
        assert [(c.id, c.events) for c in aired.counts] == [(i, len(e)) for i, e in events.items()]
        for robot, some in events.items():
            assert all(event.instant < (step + 1) * self.step_us for event in some)
            assert [e.instant for e in some] == sorted(e.instant for e in some)
            self.given.setdefault(robot, []).extend(some)
        self.steps.append(events)
        return events

    def run_all(self, frames: Sequence[Frame], steps: int) -> None:
        for _ in range(steps):
            step = self.core.step
            self.run([f for f in frames if f.instant // self.step_us == step])
