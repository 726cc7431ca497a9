"""Effects of orders and events on barrier, bodies and radio."""

from math import inf, nan
from unittest.mock import patch

import pytest

from actors.instant import Instant
from actors.messages import ANSWERED, CONTROL, Control, OrderOutcomes
from actors.orders import (
    CloseDoor,
    Freeze,
    ItemAssignment,
    Kill,
    Move,
    Obstacle,
    OpenDoor,
    Order,
    Pause,
    Restart,
    Resume,
    Speed,
    StartJam,
    Step,
    Stop,
    Thaw,
    Wall,
)
from actors.robot_model import load_model
from actors.runtime.codec import encode
from actors.runtime.core import Delivery, at
from actors.runtime.errors import AcrcError
from actors.runtime.processor import combine_fingerprints
from actors.world.body import Bodies
from tests.conduct.scripted_swarm import STEP, ScriptedRobot, ScriptedSwarm, told
from tests.refusals import refused
from tests.world.scenery import with_sensor


def ordered(play: ScriptedSwarm, *given: Order, ticket: str = "") -> list[OrderOutcomes]:
    answers: list[OrderOutcomes] = []
    play.bus.listen(at(ANSWERED), lambda d: answers.append(told(d, OrderOutcomes)))
    payload = encode(Control(0, given, ticket))
    play.world.deliver(Delivery(at(CONTROL).topic, CONTROL.key(), payload))
    return answers


def steps_of(act: ScriptedRobot) -> list[int]:
    return [senses.step for senses in act.senses]


def test_a_quiet_run_ends_at_its_limit_with_everything_delivered() -> None:
    play = ScriptedSwarm(1.0).run()
    assert steps_of(play.acts["r1"]) == list(range(11))
    assert [s.halt for s in play.acts["r1"].senses] == [False] * 10 + [True]
    assert play.undelivered == 0 and play.progress[-1].finished
    assert [truth.step for truth in play.truths] == list(range(11))


def test_a_killed_robot_leaves_the_barrier_and_its_body_stays() -> None:
    play = ScriptedSwarm(3.0, [(1.0, Kill("r2"))], talks=("r1", "r2")).run()
    assert steps_of(play.acts["r2"]) == list(range(11)) and play.acts["r2"].senses[-1].halt
    last = play.truths[-2].robots[1]
    assert (last.stepping, last.powered, last.vx) == (False, False, 0.0)
    assert last.x == pytest.approx(play.truths[20].robots[1].x, abs=1e-6)  # the watchdog has stopped it
    assert play.undelivered == 0


def test_a_frozen_robot_continues_and_gets_held_events() -> None:
    play = ScriptedSwarm(3.0, [(1.0, Freeze("r2")), (2.0, Thaw("r2"))], talks=("r1",)).run()
    r2 = play.acts["r2"]
    assert steps_of(r2) == [*range(10), *range(20, 31)]
    assert r2.senses[10].odometry.vx == pytest.approx(0.0, abs=1e-3)
    heard = [event for received in r2.received for event in received.events]
    instants = [event.instant for event in heard]
    assert instants == sorted(instants)
    assert any(1_000_000 <= instant < 2_000_000 for instant in instants)  # kept by the transceiver
    assert play.undelivered == 0


def test_a_restarted_robot_is_a_new_process_in_a_new_epoch() -> None:
    play = ScriptedSwarm(3.0, [(1.0, Kill("r2")), (2.0, Restart("r2"))], talks=("r1", "r2")).run()
    assert steps_of(play.acts["r2.1"]) == list(range(20, 31))
    assert play.undelivered == 0
    running = ScriptedSwarm(3.0, [(1.0, Restart("r2"))], talks=("r1", "r2")).run()
    assert steps_of(running.acts["r2"]) == list(range(11))
    assert steps_of(running.acts["r2.1"]) == list(range(10, 31))
    assert running.undelivered == 0 and running.digest != play.digest


def test_a_restarted_robot_gets_no_earlier_events() -> None:
    play = ScriptedSwarm(3.0, [(0.8, Freeze("r2")), (1.0, Restart("r2"))], talks=("r1", "r2")).run()
    heard = [event for received in play.acts["r2.1"].received for event in received.events]
    assert heard and min(event.instant for event in heard) >= 1_000_000
    assert [truth.robots[1].epoch for truth in play.truths[9:11]] == [0, 1]
    assert play.undelivered == 0


def test_the_last_of_several_orders_at_one_boundary_counts() -> None:
    twice = ScriptedSwarm(2.0, [(1.0, Restart("r2")), (1.0, Restart("r2"))]).run()
    assert sorted(twice.acts) == ["r1", "r2", "r2.2"] and steps_of(twice.acts["r2.2"]) == list(range(10, 21))
    killed = ScriptedSwarm(2.0, [(1.0, Restart("r2")), (1.0, Kill("r2"))]).run()
    assert sorted(killed.acts) == ["r1", "r2"] and steps_of(killed.acts["r2"]) == list(range(11))
    assert twice.undelivered == killed.undelivered == 0


def test_a_moved_robot_gets_no_earlier_scans() -> None:
    play = ScriptedSwarm(1.0, [(0.5, Move("r1", 3.0, 12.0, 1.5))], drive=lambda senses: (0.0, 0.0)).run()
    before, moved = play.truths[4].robots[0], play.truths[5].robots[0]
    assert (before.x, before.y, moved.x, moved.y, moved.heading) == (12.0, 13.0, 3.0, 12.0, 1.5)
    scans = {senses.step: senses.scan for senses in play.acts["r1"].senses}
    assert scans[4] is not None and scans[5] is None
    assert scans[6] is not None and scans[6].stamp == 600_000


def test_no_scan_of_a_fast_sensor_is_lost() -> None:
    fast = with_sensor(load_model("turtlebot2"), rate=50.0)
    setup = ScriptedSwarm.setup_of(["r1"])
    with patch("actors.world.body.load_model", lambda *_: fast):
        bodies = Bodies(setup)
    told: list[int] = []
    for step in range(4):
        senses = bodies.senses(0, step, Instant(step * STEP), 0, False)
        told += [scan.stamp for scan in (*senses.earlier_scans, senses.scan) if scan is not None]
        bodies.move(Instant(step * STEP), STEP)
    assert told == list(range(0, 300_001, 20_000))
    fast = with_sensor(load_model("turtlebot2"), rate=200.0)
    with patch("actors.world.body.load_model", lambda *_: fast), pytest.raises(AcrcError) as raised:
        Bodies(ScriptedSwarm.setup_of(["r1"]))
    assert str(raised.value) == (
        "the range sensor of 'TurtleBot 2' has a rate of 200 Hz; the maximum is 100 Hz"
    )


def test_a_jammer_blocks_the_radio_for_its_time() -> None:
    jam = StartJam(15.0, 13.0, 20.0, 500_000)
    play = ScriptedSwarm(2.0, [(1.0, jam)], talks=("r1",)).run()
    heard = {e.instant // 100_000 for received in play.acts["r2"].received for e in received.events}
    assert heard == set(range(10)) | set(range(15, 20))
    assert play.radio.counters()["frames_access_failure"] == 5  # the sender listens, and never finds it clear


def test_an_obstacle_and_a_wall_stop_a_robot() -> None:
    free = ScriptedSwarm(6.0).run().truths[-2].robots[0].x
    play = ScriptedSwarm(6.0, [(0.0, Obstacle(12.8, 13.0, 0.2))]).run()
    assert free > 13.0
    assert play.truths[-2].robots[0].x < 12.8 - 0.2 - 0.177 + 0.012
    assert play.acts["r1"].senses[-1].bumper == 2
    play = ScriptedSwarm(6.0)
    ordered(play, Wall(12.9, 12.0, 12.9, 14.0))
    assert play.run().truths[-2].robots[0].x < 12.9 - 0.05 - 0.177 + 0.012


def test_pause_and_resume_change_nothing_but_the_control_messages() -> None:
    play = ScriptedSwarm(1.0)
    ordered(play, Pause())
    with pytest.raises(AcrcError, match=r"world \(step 0\) waits for swarm/infra/control"):
        play.run()
    assert play.core.paused
    ordered(play, Resume())
    assert play.run().digest == ScriptedSwarm(1.0).run().digest
    quick = ScriptedSwarm(1.0)
    ordered(quick, Speed(2.0), Speed(0.5))
    assert quick.core.speed is None
    assert quick.run().core.speed == 0.5 and quick.digest == play.digest
    slipped = ScriptedSwarm(1.0)
    ordered(slipped, Kill("r9"))
    assert slipped.run().digest == ScriptedSwarm(1.0).run().digest
    assert list(slipped.core.report().refused_orders) == ["at 0 s: cannot kill 'r9': no such robot"]
    stepped = ScriptedSwarm(1.0)
    ordered(stepped, Step(5), Resume())
    assert stepped.run().core.step == 10, "the pause after the steps is forgotten"
    stopped = ScriptedSwarm(5.0)
    ordered(stopped, Stop())
    assert stopped.run().core.step == 0


def test_single_steps_pause_again_and_change_nothing() -> None:
    play = ScriptedSwarm(1.0)
    ordered(play, Pause())
    stands = r"no actor can continue: world \(step {}\) waits for swarm/infra/control"
    for steps, at_step in ((1, 1), (3, 4)):
        with pytest.raises(AcrcError):
            play.run()
        ordered(play, Step(steps))
        with pytest.raises(AcrcError, match=stands.format(at_step)):
            play.run()
        assert play.core.paused
    ordered(play, Resume())
    assert play.run().digest == ScriptedSwarm(1.0).run().digest


def test_a_wall_over_a_robot_is_refused_as_a_whole() -> None:
    play = ScriptedSwarm(1.0)
    answers = ordered(play, Wall(14.0, 13.0, 17.0, 13.0), ticket="mine")
    play.run()
    ((refusal,),) = [answer.refusals for answer in answers]
    assert "an obstacle of 0.05 m does not fit at" in refusal and refusal.endswith("it would overlap r2")
    assert play.digest == ScriptedSwarm(1.0).run().digest


FAR = "but must be from -1e+06 to 1e+06"
UNFIT = [
    (Wall(0.0, 0.0, nan, 0.0), f"wall.to_x is nan, {FAR}"),
    (Wall(0.0, 0.0, 80.0, 0.0), "wall.length is 80, but must be from 0 to 75"),
    (Step(0), "step.steps is 0, but must be from 1 to 1000000"),
    (Speed(nan), "speed.factor is nan, but must be from 0.01 to 1e+06"),
    (StartJam(0.0, 0.0, 5.0, 10**16), "jam.duration is 1e+10, but must be above 0 and at most 1e+06"),
    (StartJam(0.0, 0.0, 5.0, 0), "jam.duration is 0, but must be above 0 and at most 1e+06"),
    (StartJam(0.0, 0.0, inf, 10**6), "jam.radius is inf, but must be above 0 and at most 1e+06"),
    (StartJam(nan, 0.0, 2.0, 10**6), f"jam.x is nan, {FAR}"),
    (Move("r1", nan, 0.0, 0.0), f"move.x is nan, {FAR}"),
    (Move("r1", 3.0, 12.0, inf), f"move.heading is inf, {FAR}"),
    (Obstacle(inf, 0.0, 0.2), f"obstacle.x is inf, {FAR}"),
    (Obstacle(5.0, 12.0, -1.0), "obstacle.radius is -1, but must be above 0 and at most 100"),
    (Kill("r9"), "cannot kill 'r9': no such robot"),
]


@pytest.mark.parametrize(("order", "sentence"), UNFIT)
def test_invalid_orders_are_refused_and_the_run_continues(order: Order, sentence: str) -> None:
    play = ScriptedSwarm(1.0)
    answers = ordered(play, order, ticket="t1")
    assert play.run().digest == ScriptedSwarm(1.0).run().digest
    assert list(play.core.report().refused_orders) == [f"at 0 s: {sentence}"]
    assert answers == [OrderOutcomes(0, "t1", (f"at 0 s: {sentence}",))]


def test_only_orders_with_a_ticket_are_answered() -> None:
    play = ScriptedSwarm(1.0)
    assert ordered(play, Obstacle(20.0, 12.0, 0.3), ticket="t2") == []
    answers = ordered(play, Kill("r9"))
    play.run()
    assert answers == [OrderOutcomes(0, "t2", ())]
    assert play.undelivered == 0


def test_refused_orders_and_obstacles_are_limited() -> None:
    play = ScriptedSwarm(1.0)
    ordered(play, *[Kill("r9")] * 250, *[Obstacle(20.0, 12.0, 0.01)] * 1001)
    play.run()
    *kept, last = play.core.report().refused_orders
    assert len(kept) == 100 and last == "and 151 more"


def test_ended_jammers_are_removed() -> None:
    jams = [(k / 10, StartJam(12.0, 13.0, 5.0, 50_000)) for k in range(20)]
    play = ScriptedSwarm(2.5, jams, talks=("r1", "r2")).run()
    assert len(play.radio._medium.medium._interference) <= 2


SHUT = (0.4, CloseDoor(24.0, 11.1))


@pytest.mark.parametrize(
    ("order", "sentence"),
    [
        (Kill("r9"), "cannot kill 'r9': no such robot"),
        (Thaw("r1"), "cannot thaw r1, which is stepping"),
        (Move("r1", 17.05, 13.0, 0.0), "r1 does not fit at (17.05, 13): it would overlap r2"),
        (CloseDoor(9.0, 12.5), "(9, 12.5) is not at a door; the map's doors are at "),
        (OpenDoor(12.45, 9.4), "the door at (12.45, 9.4) is already open"),
        (CloseDoor(24.0, 11.2), "the door at (24, 11.2) is already closed"),
        (CloseDoor(nan, 11.1), f"close.x is nan, {FAR}"),
        (ItemAssignment("r1", ((-3.0, 12.0),)), "(-3, 12) is not on free floor; choose another place"),
        (ItemAssignment("r9", ((15.5, 12.5),)), "cannot give 'r9': no such robot"),
        (ItemAssignment("r1", ()), "give.items is 0, but must be from 1 to 1000"),
        (ItemAssignment("r1", ((inf, 0.0),)), "give.items[0] is [Infinity, 0.0], but must be a point "),
    ],
)
def test_an_invalid_event_ends_the_run(order: Order, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        ScriptedSwarm(1.0, [SHUT, (0.5, order)]).run()
    assert str(caught.value).startswith(f"event at 0.5 s failed: {sentence}")


@pytest.mark.parametrize(
    ("said", "named"),
    [
        (combine_fingerprints({"a.cos": "1" * 64, "a.sin": "4" * 64}), "a.sin"),
        ("a.sin=\x1b[2J", "a.sin"),
        ("\x1b[2J=1", "unknown kernels"),
        ("", "unknown kernels"),
    ],
)
def test_robots_with_other_results_are_refused(said: str, named: str) -> None:
    here = combine_fingerprints({"a.cos": "1" * 64, "a.sin": "2" * 64, "a.tan": "3" * 64})
    with refused(
        f"r2 and r1 compute different results in {named}; run the same version of this software on "
        "compatible processors"
    ):
        ScriptedSwarm(1.0, kernels={"r1": here, "r2": said}).run()
