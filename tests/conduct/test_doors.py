"""Doors that close and open during a run; invalid drives."""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from actors.items import ItemGivenUp, ItemKey
from actors.messages import AIRED, DRIVE, Drive, EventCount, RadioAdvanced
from actors.orders import CloseDoor, Move, Obstacle, OpenDoor, Wall
from actors.runtime.codec import encode
from actors.runtime.errors import AcrcError
from actors.world.sensing import PoseError
from cleaning.place import VisitReport
from tests.conduct.scripted_swarm import ScriptedSwarm
from tests.refusals import refused

EAST = 24.0
"""x of the passage between cabinets through which r3 drives from (20, 11) eastward."""


def eastward(
    seconds: float, *events: tuple[float, CloseDoor | OpenDoor | Move | Wall | Obstacle]
) -> ScriptedSwarm:
    return ScriptedSwarm(seconds, list(events), robots=("r3",), drive=lambda senses: (0.5, 0.0)).run()


def end(play: ScriptedSwarm) -> float:
    return play.truths[-2].robots[0].x


def test_a_closed_door_stops_a_robot_and_its_sensor_sees_it() -> None:
    free, shut = eastward(10.0), eastward(10.0, (0.0, CloseDoor(EAST, 11.1)))
    assert end(free) > EAST + 0.5
    assert EAST - 0.25 < end(shut) < EAST - 0.177 + 0.012
    assert shut.acts["r3"].senses[-1].bumper == 2 and shut.core.report().contacts == 1
    shown = [play.acts["r3"].senses[30].scan for play in (free, shut)]
    assert shown[0] is not None and shown[1] is not None
    assert shown[0].ranges_mm != shown[1].ranges_mm
    assert shut.core.report().driven == {"r3": pytest.approx(end(shut) - 20.0, abs=0.01)}
    play = eastward(13.0, (0.0, CloseDoor(EAST, 11.1)), (9.0, OpenDoor(EAST, 11.1)))
    assert end(play) > EAST + 0.5
    assert play.digest == eastward(13.0, (0.0, CloseDoor(EAST, 11.1)), (9.0, OpenDoor(EAST, 11.1))).digest


def test_obstacles_are_recorded_with_their_extent() -> None:
    play = eastward(1.0, (0.2, Wall(2.0, 11.5, 2.0, 12.5)), (0.2, Obstacle(4.0, 12.0, 0.3)))
    put = [
        (told.step, one.number, one.kind, one.points, one.radius)
        for told in play.floor.changes
        for one in told.put
    ]
    assert put == [
        (2, 0, "wall", ((2.0, 11.5), (2.0, 12.5)), 0.05), (2, 1, "obstacle", ((4.0, 12.0),), 0.3),
    ]  # fmt: skip


def test_a_door_closes_when_it_is_unobstructed() -> None:
    through = eastward(9.0)
    inside = next(truth.instant for truth in through.truths if truth.robots[0].x > EAST - 0.1) / 1e6
    play = eastward(12.0, (inside, CloseDoor(EAST, 11.1)), (11.0, OpenDoor(EAST, 11.1)))
    assert end(play) > EAST + 0.5
    with pytest.raises(AcrcError, match="it would overlap a wall"):
        eastward(12.0, (inside, CloseDoor(EAST, 11.1)), (11.0, Move("r3", EAST, 11.1, 0.0)))
    first, asked, closed, opened = play.floor.changes
    assert (first.step, first.put, first.gone) == (0, (), ())
    (waits,), (shut,) = asked.put, closed.put
    assert (waits.kind, shut.kind, shut.points) == ("closing door", "closed door", waits.points)
    assert asked.step == math.ceil(inside * 10) and (closed.gone, opened.gone) == ((0,), (1,))
    gaps = [truth.robots[0].x - EAST for truth in play.truths[asked.step : closed.step + 1]]
    assert len(gaps) > 2 and gaps[-1] > 0.177 > gaps[-3], "it closes as soon as it is empty"
    assert opened.step == 110
    never = eastward(9.0, (inside, CloseDoor(EAST, 11.1)), (inside + 0.1, OpenDoor(EAST, 11.1)))
    assert end(never) == end(through)


TRUE = Drive(7, 0.1, 0.0, 0.0, 0)
COUNT = "expected at least 1, for a robot of this run"
IN_STEP = "must be from 700000 to 799999 µs"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"step": 3}, "sent a Drive of step 3, expected step 7"),
        ({"reports": (VisitReport("r1", 0, -1),)}, f"sends a task report at -1 µs; {IN_STEP}"),
        ({"reports": (VisitReport("r1", 0, 700_000),) * 1001},
         "sends 1001 task reports in one step; the limit is 1000"),
        ({"given_up": (ItemGivenUp("r1", 0, 700_000, "x" * 10_000),)},
         "gives up an item for a reason of 10000 characters; must have 1 to 100"),
        ({"given_up": (ItemGivenUp("r1", 0, 800_000, "-"),)}, f"gives up an item at 800000 µs; {IN_STEP}"),
        ({"route": (ItemKey("r1", 0),) * 10_001}, "has a route of 10001 items; the limit is 10000"),
        ({"route": (ItemKey("r1", 0),) * 2},
         "has item 0 of 'r1' twice in its route; must be unique"),
        ({"route": (ItemKey("x" * 100, 0),)},
         f"has in its route place 0 of '{'x' * 99}…, which does not exist"),
    ],
)  # fmt: skip
def test_an_invalid_drive_ends_the_run(changes: dict[str, object], sentence: str) -> None:
    play = ScriptedSwarm(2.0)
    play.acts["r1"].lies = {7: msgspec.structs.replace(TRUE, **changes)}
    with refused(f"step 7 (0.7 s): r1 {sentence}"):
        play.run()


@pytest.mark.parametrize(
    ("aired", "sentence"),
    [
        (RadioAdvanced(5, ()), "the radio reports step 5; expected step 0"),
        *[
            (
                RadioAdvanced(0, (EventCount(robot, count),)),
                f"the radio reports {count} events for '{robot}'; {COUNT}",
            )
            for robot, count in (("r9", 1), ("r1", -1))
        ],
    ],
)
def test_wrong_counts_of_the_radio_are_refused(aired: RadioAdvanced, sentence: str) -> None:
    play = ScriptedSwarm(2.0)
    play.bus.publish(AIRED.key(), encode(aired))
    with refused(f"step 1 (0.1 s): {sentence}"):
        play.run()


LIAR, STEP = "r1", 1

any_float = st.floats(width=64)
any_whole = st.integers(-(2**63), 2**64 - 1)
owners = st.sampled_from(["r1", "r2"]) | st.text(max_size=40)
numbers = st.just(0) | any_whole
instants = st.integers(100_000, 199_999) | any_whole
velocities = st.floats(-1.0, 1.0) | any_float
poses = st.tuples(velocities, velocities, velocities)
reports = st.builds(VisitReport, owners, numbers, instants)
given_up = st.builds(ItemGivenUp, owners, numbers, instants, st.text(max_size=120))
routes = st.lists(st.builds(ItemKey, owners, numbers), max_size=4).map(tuple)
drives = st.builds(
    Drive,
    step=st.just(STEP) | any_whole,
    vx=velocities,
    vy=velocities,
    omega=velocities,
    transmits=st.just(0) | any_whole,
    reports=st.lists(reports, max_size=3).map(tuple),
    given_up=st.lists(given_up, max_size=3).map(tuple),
    route=st.none() | routes,
    pose=st.none() | poses,
)


def finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, list):
        return all(map(finite, value))
    return finite(list(value.values())) if isinstance(value, dict) else True


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@example(Drive(STEP, 1e5, -1e5, 1e5, 0, pose=(1e5, -1e5, 1e5)))
@example(Drive(STEP, 5e-324, -0.0, math.inf, 0))
@given(drives)
def test_any_drive_is_refused_or_gives_finite_numbers(drive: Drive) -> None:
    play = ScriptedSwarm(0.5)
    play.acts[LIAR].lies = {STEP: drive}
    try:
        play.run()
    except AcrcError as error:
        assert str(error).startswith(
            (f"step {STEP} (0.1 s): {LIAR} ", f"{DRIVE.key(LIAR)}: Drive.", "no actor can continue: ")
        )
        # a frame that was announced and never comes is waited for
        assert not str(error).startswith("no actor") or 0 < drive.transmits <= 32
    else:
        assert play.core.step == 5 or all(place.settled_at is not None for place in play.places)
    assert all(finite(msgspec.to_builtins(truth)) for truth in play.truths)
    for judged in (*play.places, *play.core.report().pose_errors.values()):
        assert finite(msgspec.to_builtins(judged))
        assert not isinstance(judged, PoseError) or 0 <= judged.greatest <= 2e5
    assert len(msgspec.json.encode(play.places)) < 2000
