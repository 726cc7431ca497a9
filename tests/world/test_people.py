"""People: the social force model, routes, contacts with robots, and what lidars see of them."""

import hashlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid, outline
from actors.floor.map_file import load_map
from actors.floor.placement import Area, PlacementError
from actors.geometry import Point, Pose, Twist
from actors.installation.repository import REPOSITORY
from actors.observer import glyphs
from actors.runtime.errors import AcrcError
from actors.world import people, social_force
from actors.world.people import Pedestrians, PeopleParameters, PeopleSetup
from actors.world.physics import Arena
from actors.world.sensing import RangeSensors
from actors.world.social_force import RADIUS
from tests.helpers import sampled
from tests.world.scenery import TURTLEBOT, with_sensor

CORRIDOR = load_map(REPOSITORY / "maps" / "corridor.yaml")
STARTS = [Pose(12.0, 5.0, 0.0), Pose(17.5, 5.0, 0.0), Pose(12.0, 13.0, 0.0), Pose(26.0, 11.0, 0.0)]
DIGEST = "2aff3a79c07a2947591f6e19fa0c746482df3594a289d9f611cdbaadfbea8bcd"
"""SHA-256 of all positions and velocities of six people in the first 60 s, every 0.1 s."""


def hall(width: float, depth: float) -> OccupancyGrid:
    """A hall with walls on all sides, its inner corner at (0, 0)."""
    cells = np.full((round(depth / 0.05) + 2, round(width / 0.05) + 2), OCCUPIED, np.uint8)
    cells[1:-1, 1:-1] = FREE
    return OccupancyGrid(cells, 0.05, Point(-0.05, -0.05))


def crowd(
    grid: OccupancyGrid,
    robots: Sequence[Pose] = (),
    *,
    seed: int = 1,
    areas: tuple[Area, ...] = (),
    **parameters: Any,
) -> tuple[Arena, Pedestrians]:
    setup = PeopleSetup(PeopleParameters(**parameters), areas)
    people = Pedestrians(setup, grid, seed, [pose.point for pose in robots], 0.18)
    names = [f"r{number}" for number in range(1, len(robots) + 1)]
    return Arena(outline(grid), names, [TURTLEBOT] * len(robots), robots, people), people


def walk(arena: Arena, duration: float) -> NDArray[np.float64]:
    """States of all people every 0.1 s, (steps, p, 4)."""
    states = []
    for _ in range(round(duration * 10)):
        arena.advance(10)
        states.append(arena.people.copy())
    return np.array(states)


def ends(*areas: tuple[str, float, float]) -> tuple[Area, ...]:
    """Areas of 1 m around points."""
    return tuple(Area(name, x - 0.5, y - 0.5, x + 0.5, y + 0.5) for name, x, y in areas)


def test_trajectories_are_the_known_ones() -> None:
    arena, _ = crowd(CORRIDOR, STARTS)
    assert hashlib.sha256(walk(arena, 60.0).tobytes()).hexdigest() == DIGEST


@pytest.mark.parametrize("seed", sampled(range(6), (0, 1)))
@pytest.mark.parametrize("between", ["rooms", "doors"])
def test_people_walk_without_touching_walls_and_hardly_one_another(between: str, seed: int) -> None:
    arena, people = crowd(CORRIDOR, STARTS, seed=seed, between=between, pause=1.0)
    states = walk(arena, 120.0)
    where = states[::3, :, :2].reshape(-1, 2)
    assert min(CORRIDOR.clearance_at(Point(*one), 1.0) for one in where.tolist()) > RADIUS - 0.01
    apart = np.linalg.norm(states[:, :, None, :2] - states[:, None, :, :2], axis=-1)
    apart[:, range(6), range(6)] = np.inf
    assert apart.min() > 2 * RADIUS - 0.03, "the contact solver corrects an overlap within some sub-steps"
    walked = np.linalg.norm(np.diff(states[..., :2], axis=0), axis=-1).sum(axis=0)
    assert (walked > 20.0).all()
    speeds = np.hypot(states[..., 2], states[..., 3])
    assert (speeds <= 1.3 * people.speeds + 0.2).all()
    assert arena.people_contacts == 0, "robots that stand are not touched"
    assert np.abs(arena.poses[:, :2] - [pose[:2] for pose in STARTS]).max() < 1e-9


def test_desired_speeds_have_the_given_mean_and_spread() -> None:
    _, people = crowd(hall(60.0, 60.0), count=100, speed=1.34, speed_spread=0.26)
    assert people.speeds.mean() == pytest.approx(1.34, abs=3 * 0.26 / 10)
    # the variance of a normal distribution within ±2 standard deviations, its tails moved to ±2
    assert people.speeds.std() == pytest.approx(0.26 * math.sqrt(0.921), rel=0.2)
    assert np.abs(people.speeds - 1.34).max() <= 0.52 + 1e-9


def test_a_person_alone_reaches_its_desired_speed_with_the_relaxation_time() -> None:
    areas = ends(("west", 2.0, 2.0), ("east", 38.0, 2.0))
    arena, people = crowd(hall(40.0, 4.0), areas=areas, count=1, between="areas", pause=0.0)
    states = walk(arena, 12.0)[:, 0]
    speeds = np.hypot(states[:, 2], states[:, 3])
    expected = people.speeds[0] * (1 - np.exp(-0.1 * np.arange(1, 121) / 0.54))
    assert np.abs(speeds[:60] - expected[:60]).max() < 0.03, "dv/dt = (v0 - v) / 0.54 s"
    assert speeds[60:100] == pytest.approx(people.speeds[0], rel=0.005)


def test_people_who_meet_pass_each_other() -> None:
    areas = ends(("west", 1.0, 2.0), ("east", 19.0, 2.0))
    arena, _ = crowd(hall(20.0, 4.0), areas=areas, count=2, between="areas", pause=0.0, seed=3)
    states = walk(arena, 60.0)
    apart = np.linalg.norm(states[:, 0, :2] - states[:, 1, :2], axis=1)
    order = np.sign(states[:, 0, 0] - states[:, 1, 0])
    assert (np.diff(order) != 0).sum() >= 2, "they pass"
    assert apart.min() > 2 * RADIUS - 0.01


def test_a_person_walks_around_a_robot_that_stands_in_the_way() -> None:
    areas = ends(("west", 1.0, 2.0), ("east", 19.0, 2.0))
    robot = Pose(10.0, 2.0, 0.0)
    arena, _ = crowd(hall(20.0, 4.0), [robot], areas=areas, count=1, between="areas", pause=0.0)
    states = walk(arena, 60.0)[:, 0]
    assert (np.diff(np.sign(states[:, 0] - 10.0)) != 0).sum() >= 2
    assert arena.people_contacts == 0 and arena.poses[0].tolist() == [*robot]


def test_a_person_stops_for_a_robot_that_it_cannot_pass() -> None:
    areas = ends(("west", 1.0, 0.5), ("east", 9.0, 0.5))
    robot = Pose(5.0, 0.5, 0.0)
    arena, _ = crowd(hall(10.0, 1.0), [robot], areas=areas, count=1, between="areas", pause=0.0)
    states = walk(arena, 30.0)[:, 0]
    assert (np.sign(states[:, 0] - 5.0) == np.sign(states[0, 0] - 5.0)).all()
    gap = np.hypot(*(states[:, :2] - [5.0, 0.5]).T).min() - RADIUS - 0.177
    assert 0.0 < gap < 0.3
    assert arena.people_contacts == 0 and arena.poses[0].tolist() == [*robot]


def test_the_interaction_is_that_of_the_published_model() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        e = np.array([math.cos(angle := rng.uniform(-3, 3)), math.sin(angle)])
        faster, d = rng.uniform(-2, 2, 2), rng.uniform(0.3, 5.0)
        interaction = 2.0 * faster + e
        t = interaction / np.linalg.norm(interaction)
        theta = math.remainder(math.atan2(e[1], e[0]) - math.atan2(t[1], t[0]), 2 * math.pi)
        reach = 0.35 * np.linalg.norm(interaction)
        slowing = -4.5 * math.exp(-d / reach - (3 * reach * theta) ** 2)
        turning = -4.5 * math.copysign(1, theta) * math.exp(-d / reach - (2 * reach * theta) ** 2)
        expected = slowing * t + turning * np.array([-t[1], t[0]])
        assert social_force._interaction(*e, *faster, d) == pytest.approx(expected.tolist(), abs=1e-9)


def test_a_lidar_sees_people_at_their_distance() -> None:
    grid = hall(10.0, 10.0)
    model = with_sensor(TURTLEBOT, noise=0.0, noise_growth=0.0, range_max=12.0, range_min=0.1)
    sensors = RangeSensors(grid, [model], [np.random.default_rng(0)])
    arena, _ = crowd(grid, [Pose(2.0, 5.0, 0.0)], count=1, seed=4, pause=3600.0)
    (x, y), (scan,) = arena.people[0, :2].tolist(), sensors.scan([0], arena.poses, arena.discs)
    angles = model.sensor.first_angle + model.sensor.increment * np.arange(model.sensor.rays)
    origin = np.array([2.0 + model.sensor.mount.x, 5.0 + model.sensor.mount.y])
    bearing = math.atan2(y - origin[1], x - origin[0])
    nearest = int(np.argmin(np.abs(np.angle(np.exp(1j * (angles - bearing))))))
    expected = math.hypot(x - origin[0], y - origin[1]) - RADIUS
    assert scan[nearest] / 1000 == pytest.approx(expected, abs=0.005)
    (empty,) = sensors.scan([0], arena.poses, arena.obstacles)
    assert empty[nearest] > scan[nearest]


def standing_beside_a_robot() -> Arena:
    """A person who stands for an hour in a niche, and a robot 1 m west that faces it."""
    grid, areas = hall(3.0, 1.0), (Area("east", 1.9, 0.4, 2.5, 0.6),)
    setup = PeopleSetup(PeopleParameters(count=1, between="areas", pause=3600.0), areas)
    people = Pedestrians(setup, grid, 1, [Point(0.5, 0.5)], 0.18)
    people._trips[0].until = 10**12
    (start,) = people.starts
    return Arena(outline(grid), ["r1"], [TURTLEBOT], [Pose(0.5, start.y, 0.0)], people)


def test_a_robot_that_drives_into_a_person_has_one_contact_and_its_bumper_pressed() -> None:
    arena = standing_beside_a_robot()
    pressed = 0
    for _ in range(800):
        arena.command(0, Twist(0.4, 0.0, 0.0), arena.now)
        arena.advance()
        pressed |= int(arena.bumpers[0])
    assert arena.people_contacts >= 1 and arena.contacts == 0
    assert 0.0 < arena.people_contact_us / 1e6 < 8.0
    assert pressed & 2


def test_a_person_is_an_obstacle_to_orders() -> None:
    arena = standing_beside_a_robot()
    x, y = arena.people[0, :2].tolist()
    with pytest.raises(AcrcError, match="it would overlap person 1"):
        arena.add_obstacle(Point(x + 0.1, y), 0.1)
    with pytest.raises(AcrcError, match="it would overlap person 1"):
        arena.move(0, Pose(x - 0.2, y, 0.0))
    assert arena.is_obstructed(np.array([[x, 0.0, x, 0.9]]))
    assert not arena.is_obstructed(np.array([[x - 0.5, 0.0, x - 0.5, 0.9]]))


def test_people_walk_around_obstacles_and_closed_doors() -> None:
    areas = ends(("west", 1.0, 2.0), ("east", 9.0, 2.0))
    grid = hall(10.0, 4.0)
    arena, _ = crowd(grid, areas=areas, count=1, between="areas", pause=0.0)
    for step in range(40):
        arena.add_obstacle(Point(5.0, 0.05 + 0.075 * step), 0.05)
    states = walk(arena, 40.0)[:, 0]
    assert (np.diff(np.sign(states[:, 0] - 5.0)) != 0).sum() >= 2, "through the gap that is left"
    crossing = np.flatnonzero(np.diff(np.sign(states[:, 0] - 5.0)) != 0)
    assert (states[crossing, 1] > 3.1).all()
    arena.close_door(0, np.array([[4.98, 3.0, 4.98, 4.0]]))
    side = np.sign(arena.people[0, 0] - 5.0)
    assert (np.sign(walk(arena, 40.0)[:, 0, 0] - 5.0) == side).all()
    arena.open_door(0)
    assert (np.sign(walk(arena, 60.0)[:, 0, 0] - 5.0) != side).any()


@pytest.mark.parametrize(
    ("parameters", "areas", "sentence"),
    [
        ({"between": "doors"}, (), "in the map's doors; choose other destinations"),
        ({"between": "areas"}, (Area("nook", 0.0, 0.0, 0.2, 0.2),), "in area 'nook'; choose other"),
        ({"count": 100}, (), "people.count = 100: only .* of 100 points fit"),
    ],
)
def test_people_without_room_are_one_sentence(
    parameters: dict[str, Any], areas: tuple[Area, ...], sentence: str
) -> None:
    with pytest.raises(PlacementError, match=sentence):
        crowd(hall(4.0, 4.0), areas=areas, **parameters)


def test_routes_on_a_large_map_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(people, "_MOST_CELLS", 10_000)
    crowd(hall(4.0, 4.0), count=5, between="areas", areas=(Area("all", 0.0, 0.0, 4.0, 4.0),))
    with pytest.raises(PlacementError, match=r"people\.count = 6: at most 5 on a map"):
        crowd(hall(4.0, 4.0), count=6)


def test_a_person_exactly_on_a_wall_or_an_obstacle_gets_finite_forces() -> None:
    state, forces = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]] * 2), np.zeros((1, 3))
    wishes, sees = np.array([[1.0, 0.0, 1.0, 1.0]]), np.array([[True, False]])
    walls, obstacles = np.array([[0.0, 1.0, 2.0, 1.0]]), np.array([[1.0, 1.0, 0.2]])
    social_force.social_forces(state, 1, np.array([0.2, 0.25]), wishes, sees, walls, obstacles, 0.01, forces)
    assert np.isfinite(forces).all()


def test_travel_costs_are_those_of_dijkstra() -> None:
    rng = np.random.default_rng(1)
    room = np.where(rng.random((24, 31)) < 0.3, 0.0, rng.choice([0.3, 0.6], (24, 31)))
    room[12, 15] = 0.6
    costs = np.empty(room.shape, np.uint16)
    social_force.travel_costs(room, 12, 15, costs)
    expected = np.full(room.shape, np.inf)
    expected[12, 15] = 0
    for _ in range(room.size):  # Bellman and Ford, until nothing changes
        before = expected.copy()
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                step = (7 if down and right else 5 if down or right else 0) * np.where(room >= 0.45, 1, 3)
                padded = np.pad(before, 1, constant_values=np.inf)
                moved = padded[1 + down : 25 + down, 1 + right : 32 + right]
                expected = np.where(room >= 0.25, np.minimum(expected, moved + step), expected)
        if (expected == before).all():
            break
    assert (np.where(np.isinf(expected), social_force.UNREACHED, expected) == costs).all()


def test_drawn_people_are_as_large_as_their_bodies() -> None:
    assert glyphs.PERSON_RADIUS == RADIUS
