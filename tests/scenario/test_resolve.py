"""Resolution of scenarios: starts, places, orders and errors."""

import math
from itertools import pairwise
from pathlib import Path

import pytest

from actors.geometry import Point
from actors.installation.repository import REPOSITORY
from actors.orders import (
    CloseDoor,
    Freeze,
    ItemAssignment,
    Kill,
    LoseFrame,
    Move,
    Obstacle,
    OpenDoor,
    Restart,
    StartJam,
    Thaw,
)
from actors.runtime.errors import AcrcError
from actors.world.world_setup import TimedOrder
from cleaning.place import GOLDEN
from deploy.scenario.events import item_area_tables
from deploy.scenario.resolve import ResolvedScenario, resolve, robot_setup
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.scenario.faults import MAP, scenario

CORRIDOR = REPOSITORY / "scenarios" / "corridor.toml"
AREAS = [table.area for table in item_area_tables(load_scenario(CORRIDOR))]
MOST_ROUNDING = 0.001
"""Drawn points are rounded to 1 mm, m."""


def shipped(**wishes: int) -> ResolvedScenario:
    return resolve(load_scenario(CORRIDOR, Overrides(**wishes)))  # type: ignore[arg-type]


def refusal(text: str, head: str = MAP) -> str:
    with pytest.raises(AcrcError) as caught:
        resolve(scenario(text, head=head))
    return str(caught.value)


def test_the_seed_decides_places_and_drawn_starts_but_not_given_starts() -> None:
    one, other = shipped(robots=10), shipped(robots=10, seed=2)
    assert one == shipped(robots=10) and shipped(robots=14).world.robots[:10] == one.world.robots
    for mine, others in zip(one.world.robots, other.world.robots, strict=True):
        assert mine.items != others.items
        assert (mine.start == others.start) == (mine.id != "r10")


def test_every_robot_is_told_the_addresses_of_all_robots() -> None:
    swarm = shipped(robots=3)
    setups = [robot_setup(swarm, robot) for robot in swarm.world.robots]
    assert [setup.address for setup in setups] == [1, 2, 3]
    assert {setup.members for setup in setups} == {(("r1", 1), ("r2", 2), ("r3", 3))}


def test_an_adversary_is_one_robot_also_in_the_copied_scenario() -> None:
    text = '[robots]\ncount = 3\n[[robot]]\nid = "r2"\nadversary = "forger"\n'
    swarm = resolve(scenario(text))
    setups = [robot_setup(swarm, robot) for robot in resolve(swarm.scenario).world.robots]
    assert [setup.adversary for setup in setups] == [None, "forger", None]


def test_drawn_starts_and_places_keep_their_distances() -> None:
    world = shipped(robots=16).world
    starts = [Point(*robot.start[:2]) for robot in world.robots]
    for index, drawn in enumerate(starts[9:], start=9):
        assert min(drawn.distance_to(other) for other in starts[:index]) > 0.6 - MOST_ROUNDING
    for robot in world.robots:
        places = [Point(*place) for place in robot.items]
        for place in places:
            assert any(area.x0 <= place.x <= area.x1 and area.y0 <= place.y <= area.y1 for area in AREAS)
        assert all(a.distance_to(b) > 0.6 - MOST_ROUNDING for a, b in pairwise(places))


def test_the_first_four_robots_get_golden_places_and_others_random_ones() -> None:
    text = '[robots]\ncount = 5\n[places]\npreset = "golden"\n[run]\nseed = '
    robots, others = resolve(scenario(f"{text}1")).world.robots, resolve(scenario(f"{text}2")).world.robots
    assert [robot.items for robot in robots[:4]] == [tuple(map(tuple, places)) for places in GOLDEN]
    assert robots[4].items != others[4].items
    short = resolve(scenario('[places]\npreset = "golden"\nper_robot = 3')).world.robots[1].items
    assert short == GOLDEN[1][:3]


def test_a_robots_table_overrides_common_values() -> None:
    text = (
        '[robots]\ncount = 2\nsensor = "chapter"\nstart = [[12, 5, 0], [17.5, 5, 7]]\n'
        '[[robot]]\nid = "r1"\nmodel = "omnibox"\nodometry = "exact"\n'
        "start = [12, 4, 1]\nplaces = [[12, 3]]\n"
    )
    first, second = resolve(scenario(text)).world.robots
    # the sensor for all belongs to the model for all: another model carries its own
    assert (first.model, first.sensor, first.odometry) == ("omnibox", "kinect", "exact")
    assert (first.start, first.items) == ((12.0, 4.0, 1.0), ((12.0, 3.0),))
    assert (second.model, second.sensor, second.odometry) == ("turtlebot2", "chapter", "exact")
    assert second.start == (17.5, 5.0, math.remainder(7, math.tau))
    assert len(second.items) == 10


def test_events_become_orders_in_the_order_of_their_instants() -> None:
    text = "".join(
        f"[[event]]\n{line}\n"
        for line in (
            'at = 9.5\nrestart = "r1"',
            'at = 1\nfreeze = "r1"',
            'at = 2\nthaw = "r1"',
            'at = 2\nkill = "r2"',
            'at = 0\nmove = "r3"\nto = [12, 12.5, 4]',
            "at = 3\njam = [10, 12]\nradius = 3\nduration = 1.5",
            "at = 4\nobstacle = [9, 12]\nradius = 0.2",
            'at = 4\nlose = "r2"\nof = "r1"',
            'at = 5\ngive = "r2"\nplaces = [[9, 12], [10, 12]]',
            "at = 6\nclose = [12.4, 9.4]",
            "at = 7\nopen = [12.4, 9.5]",
        )
    )
    assert resolve(scenario(text)).world.events == (
        TimedOrder(0, Move("r3", 12.0, 12.5, math.remainder(4, math.tau))),
        TimedOrder(1_000_000, Freeze("r1")),
        TimedOrder(2_000_000, Thaw("r1")),
        TimedOrder(2_000_000, Kill("r2")),
        TimedOrder(3_000_000, StartJam(10.0, 12.0, 3.0, 1_500_000)),
        TimedOrder(4_000_000, Obstacle(9.0, 12.0, 0.2)),
        TimedOrder(4_000_000, LoseFrame("r2", "r1")),
        TimedOrder(5_000_000, ItemAssignment("r2", ((9.0, 12.0), (10.0, 12.0)))),
        TimedOrder(6_000_000, CloseDoor(12.4, 9.4)),
        TimedOrder(7_000_000, OpenDoor(12.4, 9.5)),
        TimedOrder(9_500_000, Restart("r1")),
    )


MAZE = REPOSITORY / "maps" / "maze.yaml"
REFUSED = {
    "[robots]\ncount = 1\nstart = [[5, 12.5, 0]]":
        "robot 'r1' at (5.00, 12.50) is not on free floor, but must be at least 0.177 m from walls;",
    "[robots]\ncount = 2\nstart = [[12, 5, 0], [12.3, 5, 0]]":
        "robots r1 and r2 start 0.300 m apart at (12.3, 5), but must be at least 0.354 m apart",
    '[[event]]\nat = 1\nmove = "r2"\nto = [-3, 0, 0]': "robot 'r2' at (-3.00, 0.00) is outside the ",
    '[[event]]\nat = 1\ngive = "r2"\nplaces = [[5, 12.5]]': "event[0].places has [5, 12.5], but ",
    "[[event]]\nat = 1\nclose = [9, 12]":
        "event[0].close: (9, 12) is not at a door; the map's doors are at (12.52, 9.48), ",
    "[[event]]\nat = 1\nopen = [12.4, 9.4]": "event[0] cannot open a door at 1 s: it is open then",
    '[[robot]]\nid = "r2"\nplaces = [[12, 5], [5, 12.5]]': "place 1 of robot r2 is [5, 12.5], ",
    '[places]\npreset = "golden"\nper_robot = 11': "places.per_robot is 11, but must be at most 10 wh",
    '[run]\nstrategy = "prayer"': "unknown strategy 'prayer'; choose from ",
    '[radio]\npreset = "ether"': "Radio preset 'ether' is unknown; known are chapter, ",
    '[robots]\nmodel = "tank"': 'unknown robot model "tank"; must be "omnibox", ',
    '[robots]\nsensor = "eye"': 'turtlebot2.toml: the sensor is "eye", but must be ',
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED)
def test_unknown_or_conflicting_values_are_refused(text: str) -> None:
    assert refusal(text).startswith(REFUSED[text])


def test_golden_places_are_of_one_map() -> None:
    assert refusal('[places]\npreset = "golden"', head=f'map = "{MAZE}"\n').endswith(
        'places.preset "golden" is made for the map corridor'
    )


def room(folder: Path, side: float) -> str:
    """Write the map of a square room; return the first line of its scenario."""
    pixels = b"\xff" * round(side / 0.1) ** 2
    header = f"P5 {round(side / 0.1)} {round(side / 0.1)} 255\n"
    (folder / "room.pgm").write_bytes(header.encode() + pixels)
    (folder / "room.yaml").write_text(
        "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return f"map = '{folder}/room.yaml'\n"


def test_more_robots_or_places_than_there_is_room_for(tmp_path: Path) -> None:
    head = room(tmp_path, 2.0)
    too_many = refusal("[robots]\ncount = 9\n[places]\nper_robot = 0", head)
    beginning, _, end = too_many.partition(" others: ")
    number = int(beginning.rpartition(" ")[2])
    assert 0 < number < 9 and beginning == f"no start for robot r{number + 1} beside {number}"
    assert end.startswith("only 0 of 1 points fit at least 0.6 m from walls and 0.6 m from each other")
    assert refusal('[robots]\ncount = 1\n[places]\npreset = "free"', head).startswith(
        "cannot draw 10 places for robot r1 on all free floor: only "
    )
    assert len(resolve(scenario("[robots]\ncount = 1\n[places]\nper_robot = 0", head=head)).world.robots) == 1
