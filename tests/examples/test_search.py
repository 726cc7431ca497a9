"""The example task search: sight of hidden targets, reports of the base, and robots that share and relay."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import acrc_testbed
from acrc_testbed.recordings.record_replay import recheck
from acrc_testbed.testing import LossyMedium, VirtualSwarm, floor
from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.instant import START, Instant, seconds
from actors.items import ItemKey, TaskReports
from actors.task.task import JudgeSetup, TaskWorld
from deeco import replace
from examples import search
from examples.search import Briefing, SearchJudge, SearchRobot, SearchTable, Sighting
from tests.recorded_runs import record

CELLS = np.zeros((60, 120), np.uint8)
CELLS[:50, 60] = 2
GRID = OccupancyGrid(CELLS, 0.1)
"""Two rooms of 6 m by 6 m; the wall between them at x = 6 m ends 1 m below the north edge."""
SCENARIO = Path("examples/search.toml")


class GivenItems:
    """A world that keeps the items given to robots."""

    def __init__(self) -> None:
        self.items: list[tuple[str, Sighting]] = []

    def give(self, robot: str, items: Sequence[Sighting]) -> None:
        """Keep the items."""
        self.items += [(robot, one) for one in items]


def judge_of(**table: Any) -> tuple[SearchJudge, GivenItems, list[Point]]:
    """Return a judge of the base r1 and r2, its world, and the hidden targets."""
    world = GivenItems()
    setup = JudgeSetup(
        robots=("r1", "r2"),
        items={"r1": (), "r2": ()},
        settings=SearchTable(**table),
        grid=GRID,
        world=cast("TaskWorld", world),
    )
    judge = SearchJudge(setup)
    marks, _ = judge.take_changes()
    assert {mark.state for mark in marks} == {"hidden"}
    return judge, world, [Point(mark.x, mark.y) for mark in marks]


def reports(*numbers: int) -> TaskReports:
    """Return a robot's reports of targets."""
    keys = tuple(ItemKey("target", number) for number in numbers)
    return SimpleNamespace(reports=keys, given_up=(), route=None)


def test_a_robot_sees_what_no_wall_hides() -> None:
    judge, world, targets = judge_of(targets=25, sight=20.0)
    judge.watch(START, np.array([[0.55, 0.55], [0.55, 0.55]]))
    seen = {one.number for robot, one in world.items if robot == "r2"}
    wall = [0.55 + (y - 0.55) * (6.05 - 0.55) / (x - 0.55) for x, y in targets]  # y at the wall
    for number, (target, y) in enumerate(zip(targets, wall, strict=True)):
        if target.x < 5.9 or not 4.8 < y < 5.2:
            assert (number in seen) == (target.x < 6 or y > 5), target
    assert 8 < len(seen) < 25


def test_each_robot_is_given_a_target_once_with_an_error() -> None:
    judge, world, targets = judge_of(targets=3, sight=0.5, noise=0.2)
    there = np.array([[*targets[1]], [*targets[2]]])
    for step in range(3):
        judge.watch(Instant(seconds(step / 10)), there)
    assert [(robot, one.number) for robot, one in world.items] == [("r1", 1), ("r2", 2)]
    errors = [abs(one.x - targets[one.number].x) for _, one in world.items]
    assert 0 < max(errors) <= 0.2
    marks, events = judge.take_changes()
    assert [(mark.number, mark.state, mark.by) for mark in marks[1:]] == [
        (1, "seen", "r1"),
        (2, "seen", "r2"),
    ]
    assert [(event.robot, event.kind) for event in events[1:]] == [("r1", "seen"), ("r2", "seen")]


def test_only_the_base_may_report_and_only_what_was_seen() -> None:
    judge, _, targets = judge_of(targets=2, sight=0.5)
    wrong = "only the base may report a target, once a robot has seen it"
    assert judge.take("r1", reports(0), 0, 100_000) == f"reports target/0; {wrong}"
    judge.watch(START, np.array([[5.0, 5.0], [*targets[0]]]))
    judge.watch(Instant(seconds(1)), np.array([[5.0, 5.0], [*targets[1]]]))
    assert judge.take("r2", reports(0), 0, 100_000) == f"reports target/0; {wrong}"
    assert judge.take("r1", reports(0), seconds(3), seconds(3.1)) is None and not judge.settled
    assert judge.take("r1", reports(0, 1), seconds(5), seconds(5.1)) is None and judge.settled
    outcome = judge.outcome(("r1", "r2"), Instant(seconds(6)))
    expected = {"targets": 2, "found": 2, "search_s": 5.0, "seen": 2, "delay_s": 3.5}
    assert {name: outcome.values[name] for name in expected} == expected
    assert (outcome.robots["r2"], outcome.items[1]["found_s"]) == ({"seen": 2}, 5.0)


def test_the_covered_share_grows_with_what_robots_saw() -> None:
    judge, _, _ = judge_of(sight=20.0)
    judge.watch(START, np.array([[0.55, 0.55], [0.55, 0.55]]))
    half = judge.outcome((), START).values["covered"]
    judge.watch(Instant(seconds(0.5)), np.array([[11.5, 0.55], [6.0, 5.5]]))
    whole = judge.outcome((), START).values["covered"]
    assert isinstance(half, float) and isinstance(whole, float) and 0.5 < half < 0.7 < whole <= 1.0


def test_the_task_keeps_the_contract() -> None:
    assert acrc_testbed.check_task(search.Search) == []


FLOOR = floor("a..b............c...........d", 1.0)
BRIEFING = Briefing((0.0, 0.0), (29.0, 1.0), 3.0)


def robot(swarm: VirtualSwarm, name: str) -> SearchRobot:
    """Return the knowledge of a robot."""
    knowledge = swarm[name].knowledge
    assert isinstance(knowledge, SearchRobot)
    return knowledge


def medium() -> LossyMedium:
    """Return a radio that reaches 14 m, without loss."""
    place = {"r1": 0.5, "r2": 13.5, "r3": 26.5}
    return LossyMedium(reach=lambda one, other: -50.0 if abs(place[one] - place[other]) < 14 else None)


@pytest.mark.parametrize(("strategy", "reported"), [(search.alone, False), (search.sharing, True)])
def test_a_target_reaches_the_base_over_another_robot_if_robots_share(
    strategy: Any, *, reported: bool
) -> None:
    target = Sighting(5, 27.0, 0.5)
    robots = {
        "r1": ["a", BRIEFING],
        "r2": [Point(13.5, 0.5), BRIEFING],
        "r3": [Point(26.5, 0.5), BRIEFING, target],
    }
    swarm = VirtualSwarm(strategy, FLOOR, robots, medium())
    swarm.advance(seconds(8))
    assert swarm["r1"].reports == [ItemKey("target", 5)] * reported
    assert robot(swarm, "r3").confirmed == (32 if reported else 0)
    assert len(robot(swarm, "r3").targets) == (not reported)
    swarm.advance(seconds(8))
    home = Point(26.5, 0.5)
    assert (home in swarm["r3"].navigation.goals) == (not reported), "it returns with what the base lacks"


def test_robots_that_share_prefer_cells_away_from_other_goals() -> None:
    swarm = VirtualSwarm(search.sharing, FLOOR, {name: ["c", BRIEFING] for name in ("r1", "r2", "r3")})
    swarm.advance(seconds(6))
    me, plan = robot(swarm, "r2"), swarm["r2"].start.floor
    assert me.covered == robot(swarm, "r3").covered and not swarm["r1"].navigation.goals
    east, west = Point(19.5, 0.5), Point(13.5, 0.5)
    alone, apart = replace(me, peers=()), replace(me, peers=(replace(me, id="r3", goal=east),))
    assert [one.cost(plan, east) for one in (alone, apart)] == pytest.approx([3.0, 15.0], abs=0.2)
    assert apart.cost(plan, west) == pytest.approx(3.0, abs=0.2)


def test_a_relay_stands_between_the_base_and_the_farthest_robot() -> None:
    robots = {"r1": ["a", BRIEFING], "r2": ["b", BRIEFING], "r3": ["d", BRIEFING]}
    swarm = VirtualSwarm(search.relay, FLOOR, robots, settings={"link": 10.0})
    swarm.advance(seconds(5))
    goal = swarm["r2"].navigation.goals[-1]
    assert goal.distance_to(robot(swarm, "r2").home) == pytest.approx(10.0, abs=0.3)
    swarm["r2"].reach_goal()
    swarm.advance(seconds(2))
    assert swarm["r2"].navigation.commands[-1] == ("pause", None)


def test_a_covered_floor_is_covered_again() -> None:
    swarm = VirtualSwarm(search.alone, floor("a..b", 1.0), {"r1": ["a", BRIEFING], "r2": ["b", BRIEFING]})
    swarm.advance(seconds(2))
    swarm["r2"].reach_goal()
    swarm.advance(seconds(3))
    assert robot(swarm, "r2").sweep == 1


def test_a_run_finds_all_targets_and_its_replay_matches(tmp_path: Path) -> None:
    text = SCENARIO.read_text().replace('"search:', '"examples.search:')
    result = record(tmp_path / "run", text, duration=60.0, settings=(("search.targets", 2),))
    assert result.task["found"] == 2 and result.per_robot["r1"].driven_m == 0.0
    recheck(tmp_path / "run")
