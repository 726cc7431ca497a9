"""Physics of robots, walls and obstacles; effects of orders at a step boundary."""

import gc
import math
from collections.abc import Callable
from typing import cast

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant
from actors.messages import Jam, ProcessOrder
from actors.orders import Freeze, Kill, Pause, Restart, Resume, StartJam, Stop
from actors.robot_model import OdometryKind, RobotModel
from actors.runtime.errors import AcrcError
from actors.task.task import Judge, Task
from actors.world.body import Bodies
from actors.world.order_execution import OrderEffects, Orders
from actors.world.physics import SUBSTEP, Arena, Shape, disc, footprint_at, gap, wall_gap
from actors.world.world_setup import BarrierState, BodySetup, Participants, TimedOrder
from tests.world.scenery import AHEAD, OMNIBOX, TURTLEBOT, arena, overlap, room, room_with_door, towards

MM = 0.001


def drive(world: Arena, *twists: Twist, duration: float = 1.0) -> float:
    deepest = 0.0
    for _ in range(round(duration * 100)):
        for index, twist in enumerate(twists):
            world.command(index, twist, world.now)
        world.advance()
        deepest = max(deepest, overlap(world))
    return deepest


def test_a_differential_drive_runs_on_the_circle_of_its_command_and_never_sideways() -> None:
    world = arena(Pose(1, 0, math.pi / 2))
    drive(world, Twist(0.5, 0, 0.5), duration=2.0)
    centre = world.poses[0, :2] + np.array([-math.sin(world.poses[0, 2]), math.cos(world.poses[0, 2])])
    for _ in range(40):
        drive(world, Twist(0.5, 0.3, 0.5), duration=0.3)
        assert np.hypot(*(world.poses[0, :2] - centre)) == pytest.approx(1.0, abs=3 * MM)
        turned = complex(*world.velocities[0, :2]) * np.exp(-1j * world.poses[0, 2])
        assert turned.imag == pytest.approx(0, abs=1e-12)
    world = arena(Pose(0, 0, 3.0))
    for _ in range(300):
        drive(world, Twist(0, 0, 5.0), duration=0.05)
        assert -math.pi < world.poses[0, 2] <= math.pi


def test_an_omnidirectional_drive_goes_sideways_while_it_turns() -> None:
    world = arena(Pose(0, 0, 0), model=OMNIBOX)
    drive(world, Twist(0, 0.6, 0), duration=2.0)
    assert world.velocities[0] == pytest.approx([0, 0.6, 0])
    drive(world, Twist(0.9, 0.9, 1.0), duration=1.5)
    assert np.hypot(*world.velocities[0, :2]) == pytest.approx(0.8, abs=2 * MM)
    assert world.velocities[0, 2] == pytest.approx(1.0)


def test_a_command_expires_after_the_watchdog_timeout() -> None:
    world = arena(Pose(-2, 0, 0))
    world.command(0, AHEAD, Instant(0))
    world.advance(51)
    assert world.velocities[0, 0] == pytest.approx(0.5)  # the last sub-step began when it was 0.5 s old
    world.advance(10)
    assert world.velocities[0, 0] == pytest.approx(0.4)
    world.advance(100)
    where = world.poses.copy()
    world.advance(300)
    assert np.array_equal(world.poses, where)


def test_wheels_follow_commands_after_the_delay_of_the_drive() -> None:
    drive_parameters = msgspec.structs.replace(TURTLEBOT.drive, delay=0.08)
    world = arena(Pose(-2, 0, 0), model=msgspec.structs.replace(TURTLEBOT, drive=drive_parameters))
    world.command(0, AHEAD, Instant(0))
    world.advance(8)
    assert world.velocities[0, 0] == 0.0
    world.command(0, STILL, Instant(80_000))
    world.advance(8)
    assert world.velocities[0, 0] == pytest.approx(0.08)
    world.advance(8)
    assert world.velocities[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_advance_gives_the_pose_after_every_sub_step() -> None:
    one, other = arena(Pose(0, 0, 3.1)), arena(Pose(0, 0, 3.1))
    for world in (one, other):
        world.command(0, Twist(0.3, 0, 2.0), Instant(0))
    track = one.advance(20)
    singly = np.concatenate([other.advance() for _ in range(20)])
    assert track.shape == (20, 1, 3) and np.array_equal(track, singly)
    assert np.array_equal(track[-1], one.poses) and one.now == Instant(20 * SUBSTEP)
    world = arena()
    assert world.advance(3).shape == (3, 0, 3) and overlap(world) == 0 and world.now == Instant(30_000)


@pytest.mark.parametrize("share", range(0, 10, 3))
def test_two_robots_meeting_head_on_overlap_by_12_mm_at_most_and_2_mm_at_rest(share: int) -> None:
    world = arena(Pose(-0.8 - share * MM, 0, 0), Pose(0.8, 0, math.pi))
    assert drive(world, AHEAD, AHEAD, duration=2.0) <= 12 * MM
    assert drive(world, AHEAD, AHEAD, duration=1.0) <= 2 * MM
    assert world.poses[1, 0] - world.poses[0, 0] == pytest.approx(0.354, abs=2 * MM)
    assert world.bumpers.tolist() == [2, 2] and world.contacts == 1


@pytest.mark.parametrize(
    ("poses", "model"),
    [
        *[([pose], TURTLEBOT) for pose in (Pose(3.9, 0, 0), Pose(3.9, 0, 0.4), Pose(4, 4, math.pi / 4))],
        *[([pose], OMNIBOX) for pose in (Pose(3.9, 0, 0.3), Pose(4, 4, 0.7))],
        ([Pose(-0.8, 0, 0), Pose(0.8, 0.1, 3)], OMNIBOX),
    ],
)
def test_walls_corners_and_boxes_hold(poses: list[Pose], model: RobotModel) -> None:
    world = arena(*poses, model=model)
    twists = [AHEAD] * len(poses)
    assert drive(world, *twists, duration=3.0) <= 12 * MM
    assert drive(world, *twists, duration=1.0) <= 2 * MM
    assert world.contacts >= 1


def test_a_box_cannot_turn_with_its_side_on_a_wall_but_can_leave() -> None:
    world = arena(Pose(4.809, 0, math.pi / 2), model=OMNIBOX)
    assert drive(world, Twist(0, 0, 2.0), duration=2.0) <= 2 * MM
    assert world.poses[0] == pytest.approx([4.809, 0, math.pi / 2], abs=20 * MM)
    drive(world, Twist(0, 0.5, 0), duration=1.5)
    drive(world, Twist(0, 0, 2.0), duration=1.0)
    assert world.poses[0, 0] < 4.6 and world.velocities[0, 2] == pytest.approx(2.0)


def test_ten_robots_pushing_into_a_door_and_many_more_contacts() -> None:
    contacts = 0
    for spread in (0.40, 0.45, 0.50):
        places = [(-1 - spread * (k // 5), spread * (k % 5 - 2)) for k in range(10)]
        world = arena(*[towards(0.3, 0, x, y) for x, y in places], walls=room_with_door())
        assert drive(world, *[AHEAD] * 10, duration=6.0) <= 12 * MM
        assert drive(world, *[AHEAD] * 10, duration=1.0) <= 2 * MM
        contacts += world.contacts
    assert contacts >= 100


@pytest.mark.parametrize(
    ("bearing_deg", "bits"),
    [(0, 2), (29, 2), (-29, 2), (31, 4), (89, 4), (-31, 1), (-89, 1), (91, 0), (180, 0), (-91, 0)],
)
@pytest.mark.parametrize("first", [True, False])
def test_bumper_bits_by_bearing(bearing_deg: float, bits: int, first: bool) -> None:
    bearing = 0.5 + math.radians(bearing_deg)
    still, rammed = Pose(0, 0, 0.5), Pose(0.4 * math.cos(bearing), 0.4 * math.sin(bearing), bearing)
    backwards = Twist(-0.2, 0, 0)
    world = arena(still, rammed) if first else arena(rammed, still)
    index = 0 if first else 1
    drive(world, *((STILL, backwards) if first else (backwards, STILL)), duration=0.5)
    assert world.bumpers[index] == bits and world.bumpers[1 - index] == 0 and world.contacts == 1


def test_bumper_bits_last_until_the_next_advance() -> None:
    world = arena(Pose(4.8, 0, 0))
    world.command(0, AHEAD, world.now)
    world.advance(30)
    world.command(0, Twist(-0.5, 0, 0), world.now)
    world.advance(30)
    assert world.bumpers.tolist() == [2] and overlap(world) == 0.0
    world.advance(30)
    assert world.bumpers.tolist() == [0]


def test_a_standing_robot_is_pushed_away_by_a_crowd_and_not_by_one() -> None:
    queue = [Pose(-0.36 * k, 0, 0) for k in range(8)]  # seven push with 10 N each, one holds with 50 N
    crowd = arena(*queue)
    drive(crowd, STILL, *[AHEAD] * 7, duration=3.0)
    assert crowd.poses[0, 0] > 0.2
    pair = arena(*queue[:2])
    drive(pair, STILL, AHEAD, duration=3.0)
    assert 0 < pair.poses[0, 0] < 0.02 and np.abs(pair.velocities).max() < 1 * MM


def test_a_moved_robot_stands_still_where_it_was_put_and_drives_on_from_there() -> None:
    world = arena(Pose(-2, 0, 0), Pose(2, 2, 0))
    drive(world, AHEAD, STILL)
    world.move(0, Pose(2, 0, math.pi / 2))
    assert world.poses[0].tolist() == [2, 0, math.pi / 2] and world.velocities[0].tolist() == [0, 0, 0]
    assert drive(world, AHEAD, STILL, duration=4.5) <= 12 * MM
    assert world.poses[0, 1] > 1.6 and world.contacts == 1  # it meets the other robot there


def wandering(worlds: list[Arena], steps: int = 30) -> list[list[bytes]]:
    rng = np.random.default_rng(5)
    states: list[list[bytes]] = [[] for _ in worlds]
    for step in range(steps):
        twists = [Twist(*rng.uniform((0, 0, -3), (0.5, 0, 3)).tolist()) for _ in range(len(worlds[0]))]
        for world, seen in zip(worlds, states, strict=True):
            for index, twist in enumerate(twists):
                world.command(index, twist, world.now)
            if step == steps // 2:
                world.add_obstacle(Point(4.5, 4.5), 0.2)
                world.move(0, Pose(-4.5, -4.5, 0.0))
            world.advance(30)
            arrays: list[NDArray[np.generic]] = [world.poses, world.velocities, world.bumpers]
            seen.append(b"".join(array.tobytes() for array in arrays) + bytes(str(world.contacts), "ascii"))
    return states


def test_the_same_calls_give_bit_equal_states() -> None:
    def crowd() -> Arena:
        return arena(*[Pose(-1.2 + 0.4 * (k % 6), -1 + 0.4 * (k // 6), k * 0.3) for k in range(30)])

    alone = wandering([crowd()], 30)[0]
    rubbish = [np.zeros(77 * k) for k in range(50)]  # so that later bodies lie elsewhere in memory
    one, other = wandering([crowd(), crowd()], 30)
    assert len(rubbish) == 50 and alone == one == other and len(set(alone)) == 30


@pytest.mark.parametrize(
    ("attempt", "sentence"),
    [
        (lambda world: world.move(0, Pose(2.1, 2, 0)), "r0 does not fit at (2.1, 2): it would overlap r1"),
        (lambda world: world.move(0, Pose(4.9, 0, 0)),
         "r0 does not fit at (4.9, 0): it would overlap a wall"),
        (lambda world: world.move(0, Pose(-3, 0, 0)),
         "r0 does not fit at (-3, 0): it would overlap an obstacle"),
        (lambda world: world.add_obstacle(Point(2, 2.2), 0.1),
         "an obstacle of 0.1 m does not fit at (2, 2.2): it would overlap r1"),
        (lambda world: world.add_obstacle(Point(0, 0), -1.0),
         "an obstacle at (0, 0) has a radius of -1 m; its coordinates must be finite, its radius "
         "between 0 and 100 m"),
        (lambda world: world.command(1, Twist(math.nan, 0, 0), Instant(0)),
         "r1 commands nan, 0 m/s and 0 rad/s; velocities must be finite"),
        (lambda _: arena(Pose(0, 0, 0), Pose(0.3, 0, 0)), "r1 does not fit at (0.3, 0): it would overlap r0"),
        (lambda _: arena(Pose(0, -4.9, 0), model=OMNIBOX),
         "r0 does not fit at (0, -4.9): it would overlap a wall"),
    ],
)  # fmt: skip
def test_invalid_positions_and_commands_are_refused(
    attempt: Callable[[Arena], object], sentence: str
) -> None:
    world = arena(Pose(-1, 0, 0), Pose(2, 2, 0))
    world.add_obstacle(Point(-3.1, 0), 0.1)
    before = world.poses.tobytes()
    with pytest.raises(AcrcError) as caught:
        attempt(world)
    assert str(caught.value) == sentence and world.poses.tobytes() == before


def test_the_space_of_a_deleted_arena_is_emptied() -> None:
    world = arena(Pose(1.0, 1.0, 0.0))
    space, cycle = world._space, [world]
    cycle.append(cycle)  # type: ignore[arg-type]
    assert space.shapes and space.bodies
    del world, cycle
    gc.collect()
    assert not space.shapes and not space.bodies


poses = st.builds(Pose, st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-3, 3))
BOX = Shape(np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), 0.0)


def shifted(shape: Shape, by: complex) -> Shape:
    return Shape(shape.vertices + np.array([by.real, by.imag]), shape.radius)


def line(x0: float, y0: float, x1: float, y1: float) -> Shape:
    return Shape(np.array([[x0, y0], [x1, y1]]), 0.0)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (disc(0, 0, 1), disc(3, 4, 2), 2.0),
        (disc(0, 0, 1), disc(0.5, 0, 1), -1.5),
        (disc(0, 0, 0.5), line(1, -1, 1, 1), 0.5),
        (disc(0, 0, 0.5), line(0.4, -1, 0.4, 1), -0.1),
        (disc(0, 0, 0.5), line(3, 4, 9, 4), 4.5),  # nearest at its end
        (disc(2, 0, 0.5), BOX, 0.5),
        (disc(2, 2, 0.5), BOX, math.sqrt(2) - 0.5),
        (disc(0.7, 0, 0.5), BOX, -0.8),  # its centre is inside: 0.3 to the edge, and its radius
        (line(2, -3, 2, 3), BOX, 1.0),
        (line(0.8, -3, 0.8, 3), BOX, -0.2),
        (shifted(BOX, 1.9 + 0.5j), BOX, -0.1),
        (shifted(BOX, 3 + 3j), BOX, math.sqrt(2)),
    ],
)
def test_known_gaps(a: Shape, b: Shape, expected: float) -> None:
    assert gap(a, b) == pytest.approx(expected, abs=1e-12)
    assert gap(b, a) == pytest.approx(expected, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(poses, poses)
def test_moving_apart_by_the_overlap_is_enough_and_by_less_is_not(one: Pose, other: Pose) -> None:
    a, b = footprint_at(OMNIBOX.footprint, one), footprint_at(OMNIBOX.footprint, other)
    depth = -gap(a, b)
    if depth <= 1e-3:
        return
    ways = np.exp(1j * np.linspace(0, math.tau, 360, endpoint=False))
    gaps_by = {share: [gap(shifted(a, way * depth * share), b) for way in ways] for share in (0.98, 1.001)}
    assert max(gaps_by[0.98]) < 0
    assert max(gaps_by[1.001]) > -depth * 0.02


@given(poses)
def test_the_gap_of_apart_shapes_is_that_of_their_nearest_border_points(pose: Pose) -> None:
    a = footprint_at(OMNIBOX.footprint, pose)
    b = footprint_at(TURTLEBOT.footprint, Pose(0, 0, 0))
    if gap(a, b) > 0:
        assert gap(a, b) == pytest.approx(np.hypot(*border(a).T).min() - 0.177, abs=2e-3)


def border(shape: Shape) -> NDArray[np.float64]:
    steps = np.linspace(0, 1, 300)[:, None]
    ends = np.roll(shape.vertices, -1, axis=0)
    return np.concatenate([a + steps * (b - a) for a, b in zip(shape.vertices, ends, strict=True)])


def test_only_walls_that_can_overlap_count() -> None:
    assert wall_gap(disc(4.9, 0, 0.2), room()) == pytest.approx(-0.1)
    assert wall_gap(footprint_at(OMNIBOX.footprint, Pose(4.8, 4.8, 0)), room()) == pytest.approx(-0.05)
    assert wall_gap(disc(4.5, 0, 0.2), room()) == math.inf


NOWHERE = cast(Bodies, None)
"""Unused: the orders of these tests do not concern bodies."""
TASK, JUDGE = cast(Task, None), cast(Judge, None)
"""Unused, too."""
KIND: OdometryKind = "stage"


def orders(*events: TimedOrder) -> Orders:
    robots = tuple(
        BodySetup(id=name, model="turtlebot2", sensor=None, odometry=KIND, start=(0.0, 0.0, 0.0), items=())
        for name in ("r1", "r2")
    )
    roster = Participants(robots)
    for member in roster.members:
        member.state = BarrierState.STEPPING
    return Orders(events, roster, NOWHERE, TASK, JUDGE)


def test_due_events_have_their_effects() -> None:
    early = TimedOrder(100, StartJam(1.0, 2.0, 3.0, 50))
    asked = orders(early, TimedOrder(200, Restart("r1")), TimedOrder(900, Stop()))
    asked.begin(Instant(200))
    assert asked.effects == OrderEffects([ProcessOrder("r1", 1)], ["r1"], [Jam(1.0, 2.0, 3.0, 250)])
    assert asked.pending
    asked.begin(Instant(300))
    assert asked.effects == OrderEffects()
    asked.begin(Instant(900))
    assert asked.effects == OrderEffects(stop=True) and not asked.pending


def test_a_process_killed_before_its_start_is_not_started() -> None:
    asked = orders()
    assert asked.take([Restart("r1"), Pause()]) == ()
    assert asked.effects.paused and asked.effects.starts == [ProcessOrder("r1", 1)]
    assert asked.take([Kill("r1"), Resume()]) == ()
    assert asked.effects == OrderEffects(ends=["r1"], steps=0)
    asked = orders()
    refusals = asked.take([Freeze("r9"), Kill("r2")])
    assert asked.effects == OrderEffects(ends=["r2"])
    assert refusals == asked.refused == ("at 0 s: cannot freeze 'r9': no such robot",)
