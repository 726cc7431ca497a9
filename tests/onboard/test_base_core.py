"""The base conducts its robot by the clock: what it sends when, and what it does with what comes late."""

import math
from collections.abc import Sequence

import pytest

from actors.geometry import Pose
from actors.instant import Instant, seconds
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    RADIO_READY,
    READY,
    Aired,
    Control,
    Drive,
    EventCount,
    Odometry,
    Progress,
    Ready,
    Scan,
    Senses,
    Truth,
)
from actors.orders import Order, Pause, Resume, Stop
from actors.runtime.core import Address, Output, at
from actors.runtime.errors import AcrcError
from actors.topic import Message
from firmware_bridge.onboard.base_core import AIR_PATIENCE, BaseCore

STEP = 100_000
START = Pose(10.0, 5.0, math.pi / 2)
BEGIN = 1_700_000_000_000_000


class Vehicle:
    def __init__(self) -> None:
        self.commands: list[tuple[int, float, float]] = []
        self.issued: list[int] = []
        self.sweep: Scan | None = None
        self.causes: tuple[str, ...] = ()

    def held(self) -> tuple[str, ...]:
        return self.causes

    def odometry(self) -> Odometry:
        return Odometry(1.0, 2.0, 0.5, 0.1, 0.0, 0.2)

    def bumper(self) -> int:
        return 2

    def scan(self) -> Scan | None:
        sweep, self.sweep = self.sweep, None
        return sweep

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        self.commands.append((now - BEGIN, vx, omega))
        self.issued.append(issued - BEGIN)


class Stage:
    """A base core with the others played by the test; times are µs after BEGIN."""

    def __init__(self) -> None:
        self.vehicle = Vehicle()
        self.core = BaseCore("r1", STEP, Instant(BEGIN), START, 10, self.vehicle)

    def at(
        self, time_us: int, address: Address | None = None, message: Message | None = None
    ) -> list[Message]:
        self.core.now = Instant(BEGIN + time_us)
        inputs: dict[str, Message] = {}
        if address is not None and message is not None:
            self.core.expect(address.key)
            assert [one.key for one in self.core.missing({})] == [address.key]
            inputs[address.key] = message
        assert list(self.core.missing(inputs)) == []
        return shown(self.core.advance(inputs))

    def ready(self) -> None:
        assert self.at(10, at(READY, "r1"), Ready(0, "r1", 0, "")) == []
        assert self.at(20, at(RADIO_READY), Ready(0, "radio", 0, "")) == []

    def drive(self, time_us: int, step: int, vx: float = 0.3, transmits: int = 0) -> list[Message]:
        return self.at(time_us, at(DRIVE, "r1"), Drive(step, vx, 0.0, 0.1, transmits))

    def aired(self, time_us: int, step: int, events: int = 0) -> list[Message]:
        counts = (EventCount("r1", events),) if events else ()
        return self.at(time_us, at(AIRED), Aired(step, counts))


def shown(outputs: Sequence[Output]) -> list[Message]:
    return [output.message for output in outputs if isinstance(output.message, Senses | Truth)]


def first_step(stage: Stage) -> None:
    """Step 1 is opened, for it is the first after everybody is there, and is answered in 4 ms."""
    stage.ready()
    sweep = stage.vehicle.sweep
    (senses,) = stage.at(STEP)
    assert senses == Senses(1, BEGIN + STEP, 0, Odometry(1.0, 2.0, 0.5, 0.1, 0.0, 0.2), 2, sweep)
    assert stage.drive(STEP + 4_000, 1, transmits=3) == []


def test_a_robot_or_bridge_that_does_not_answer_for_too_long_is_named() -> None:
    robot, bridge = Stage(), Stage()
    for stage in (robot, bridge):
        stage.core.patience = seconds(1.0)
        first_step(stage)
        stage.at(2 * STEP)
    robot.aired(2 * STEP + 1000, 1)
    with pytest.raises(AcrcError) as hung:
        for step in range(3, 20):
            robot.at(step * STEP)
    assert str(hung.value) == "step 13: r1 has not answered for 1 s"
    with pytest.raises(AcrcError) as hung:
        for step in range(2, 20):
            bridge.at(step * STEP + 25_000)
            bridge.drive(step * STEP + 27_000, step)
            bridge.at((step + 1) * STEP)
    assert str(hung.value) == "step 13: the radio's bridge has not answered for 1 s"


def test_a_step_begins_at_its_instant_and_the_answer_drives_the_robot_at_once() -> None:
    stage = Stage()
    stage.vehicle.sweep = Scan(5, b"\x01\x02")
    first_step(stage)
    assert stage.vehicle.commands == [(104_000, 0.3, 0.1)]
    assert stage.vehicle.issued == [STEP], "as old as what it was decided from"
    (truth,) = stage.at(2 * STEP)
    assert isinstance(truth, Truth)
    assert (truth.step, truth.instant, truth.robots[0].transmits) == (1, BEGIN + STEP, 3)
    (robot,) = truth.robots
    assert (robot.x, robot.y) == pytest.approx((8.0, 6.0)), "odometry, from where it was switched on"
    assert robot.heading == pytest.approx(math.pi / 2 + 0.5)
    assert math.hypot(robot.vx, robot.vy) == pytest.approx(0.1)
    (senses,) = stage.aired(2 * STEP + 1_000, 1, events=2)
    assert isinstance(senses, Senses)
    assert (senses.step, senses.instant, senses.events) == (2, BEGIN + 2 * STEP, 2)
    assert stage.core.outcome()["lateness_ms"] == {"4": 1}


def test_a_robot_that_has_not_answered_misses_steps_and_is_not_waited_for() -> None:
    stage = Stage()
    assert stage.at(STEP - 10) == [], "nothing is sent before the robot is there"
    stage.ready()
    stage.at(STEP)
    assert stage.at(2 * STEP) == stage.at(3 * STEP) == []
    assert stage.core.overruns == 2
    stage.drive(3 * STEP + 50_000, 1)
    assert [message.step for message in stage.at(4 * STEP)] == [1]
    assert [message.step for message in stage.aired(4 * STEP + 500, 1)] == [4]
    assert stage.core.outcome()["lateness_ms"] == {"250": 1}
    stage.drive(4 * STEP + 1_000, 4)
    stage.at(9 * STEP + 30_000)
    (senses,) = stage.aired(9 * STEP + 31_000, 4)
    assert isinstance(senses, Senses) and (senses.step, senses.instant) == (9, BEGIN + 9 * STEP), (
        "on the grid"
    )


def test_a_bridge_that_is_late_is_heard_a_step_later_and_asked_no_second_time() -> None:
    stage = Stage()
    first_step(stage)
    assert len(stage.at(2 * STEP)) == 1
    assert stage.core.wake == BEGIN + 2 * STEP + AIR_PATIENCE
    (senses,) = stage.at(2 * STEP + AIR_PATIENCE)
    assert isinstance(senses, Senses) and senses.events == 0
    assert stage.core.late_air == 1
    stage.drive(2 * STEP + 30_000, 2)
    assert stage.aired(2 * STEP + 40_000, 1, events=3) == [], "it waits for the next step"
    (senses,) = stage.at(3 * STEP)
    assert isinstance(senses, Senses) and (senses.step, senses.events) == (3, 3)
    stage.drive(3 * STEP + 2_000, 3)
    assert [type(message) for message in stage.at(4 * STEP)] == [Truth], "all that was heard is handed over"


def test_a_bridge_that_never_answers_costs_the_radio_only() -> None:
    stage = Stage()
    first_step(stage)
    stage.at(2 * STEP)
    for step in range(2, 6):
        (senses,) = stage.at(step * STEP + AIR_PATIENCE)
        assert isinstance(senses, Senses) and (senses.step, senses.events) == (step, 0)
        stage.drive(step * STEP + AIR_PATIENCE + 1_000, step)
        assert stage.at((step + 1) * STEP) == []
    stage.at(6 * STEP + 1_000, at(RADIO_READY), Ready(0, "radio", 1, ""))
    stage.at(6 * STEP + AIR_PATIENCE)
    stage.drive(6 * STEP + 50_000, 6)
    assert [type(message) for message in stage.at(7 * STEP)] == [Truth], "a new bridge is asked"


def test_a_restarted_robot_is_taken_along_and_owes_nothing() -> None:
    stage = Stage()
    first_step(stage)
    stage.at(2 * STEP)
    stage.aired(2 * STEP + 100, 1)
    stage.at(2 * STEP + 50_000, at(READY, "r1"), Ready(0, "r1", 1, ""))
    assert stage.drive(2 * STEP + 60_000, 2) == [], "of the one before"
    assert stage.core.stale == 1
    assert len(stage.at(3 * STEP)) == 1 and stage.core.overruns == 0


def test_what_a_slow_bridge_says_of_a_robot_that_has_ended_is_not_counted_for_its_successor() -> None:
    """It would wait for a Received that has gone to nobody, for ever."""
    stage = Stage()
    first_step(stage)
    assert len(stage.at(2 * STEP)) == 1
    stage.at(2 * STEP + 60_000, at(READY, "r1"), Ready(0, "r1", 1, ""))
    (truth,) = stage.at(3 * STEP)
    assert isinstance(truth, Truth) and truth.robots[0].epoch == 1, "asked again, of the new one"
    assert stage.aired(3 * STEP + 100, 1, events=4) == [], "the answer to the first"
    (senses,) = stage.aired(3 * STEP + 200, 1)
    assert isinstance(senses, Senses) and senses.events == 0


@pytest.mark.parametrize("how", ["order", "signal"])
def test_the_last_messages_halt_robot_and_bridge_and_stop_the_vehicle(how: str) -> None:
    stage = Stage()
    first_step(stage)
    if how == "signal":
        stage.core.stop()
        last = stage.at(150_000)
    else:
        last = stage.at(150_000, at(CONTROL), Control(0, (Stop(),)))
    assert [(type(message), message.step) for message in last] == [(Senses, 2), (Truth, 2)]
    assert all(isinstance(message, Senses | Truth) and message.halt for message in last)
    assert stage.core.finished and stage.vehicle.commands[-1] == (150_000, 0.0, 0.0)


@pytest.mark.parametrize(
    ("order", "paused", "finished"), [(Pause(), True, False), (Resume(), False, False), (Stop(), False, True)]
)
def test_progress_tells_what_was_obeyed_and_what_holds_it(order: Order, paused: bool, finished: bool) -> None:
    stage = Stage()
    stage.vehicle.causes = ("the battery is low",)
    first_step(stage)
    stage.core.now = Instant(BEGIN + 150_000)
    stage.core.expect(CONTROL.key())
    outputs = stage.core.advance({CONTROL.key(): Control(0, (order,))})
    (said,) = (output.message for output in outputs if isinstance(output.message, Progress))
    assert (said.paused, said.finished, said.held) == (paused, finished, ("the battery is low",))
    assert (stage.vehicle.commands[-1] == (150_000, 0.0, 0.0)) is not isinstance(order, Resume)
    assert finished or bool(stage.at(2 * STEP)) is not paused, "while paused no step begins"
