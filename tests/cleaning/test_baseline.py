"""Stories of one robot with the naive solution."""

import itertools
from typing import NamedTuple

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Heard, Overflow, PlaceKey, PlaceReport, RadioEvent
from actors.randomness import generator
from actors.robot.behaviour import load_behaviour
from actors.robot.ports import AbortReason, Decision, Goal, GoalOrder, GoalStatus, Start, View
from cleaning.baseline import Baseline, behaviour
from cleaning.knowledge import Knowledge, WorkState, pack, unpack
from cleaning.strategies import STRATEGIES

STEP = 100_000
PLACES = (Point(5.0, 0.0), Point(10.0, 0.0), Point(2.0, 0.0))


def start(robot: str = "r1", places: tuple[Point, ...] = PLACES, epoch: int = 0) -> Start:
    return Start(robot, 1, epoch, Pose(0.0, 0.0, 0.0), places, generator(3, "behaviour", robot, epoch))


class Decided(NamedTuple):
    instant: Instant
    decision: Decision


class Robot:
    """A baseline whose navigation goes where it is told by the test."""

    def __init__(self, given: Start) -> None:
        self.baseline = Baseline(given)
        self.now = 0
        self.x = 0.0
        self.goal: Goal | None = None
        self.decided: list[Decided] = []

    def run(self, seconds: float, *radio: RadioEvent) -> list[Decided]:
        decided = []
        for _ in range(round(seconds * 10)):
            view = View(Instant(self.now), Pose(self.x, 0.0, 0.0), False, self.goal, radio)
            decision = self.baseline.advance(view, Instant(self.now + STEP))
            decided.append(Decided(view.instant, decision))
            if isinstance(decision.goal, Point):
                self.goal = Goal(decision.goal, GoalStatus.ACTIVE)
            self.now += STEP
            radio = ()
        self.decided += decided
        return decided


def goals(decided: list[Decided]) -> list[tuple[int, Point]]:
    return [(at, d.goal) for at, d in decided if isinstance(d.goal, Point)]


def reports(decided: list[Decided]) -> list[PlaceReport]:
    return [report for _, d in decided for report in d.reports]


def route(robot: Robot) -> list[int]:
    """The places that it last said it still means to visit; at first, all."""
    said = [d.route for _, d in robot.decided if d.route is not None]
    return [key.place for key in said[-1]] if said else list(range(len(PLACES)))


def test_it_goes_to_its_places_in_order_and_reports_each() -> None:
    robot = Robot(start())
    assert goals(robot.run(1)) == [(0, PLACES[0])]
    robot.x = 4.51
    arrived = robot.run(1)
    assert reports(arrived) == [PlaceReport("r1", 0, 1_000_000)]
    assert goals(arrived) == [(1_000_000, PLACES[1])]
    robot.x = 9.51
    robot.run(1)
    robot.x = 2.49
    last = robot.run(1)
    assert reports(last) == [PlaceReport("r1", 2, 3_000_000)]
    assert goals(last) == [] and route(robot) == []
    assert all(d.goal is GoalOrder.KEEP for _, d in last)


def test_places_it_passes_are_visited_too() -> None:
    robot = Robot(start())
    robot.run(1)
    robot.x = 2.2
    assert reports(robot.run(1)) == [PlaceReport("r1", 2, 1_000_000)]
    robot.x = 5.0
    assert goals(robot.run(1)) == [(2_000_000, PLACES[1])]
    robot.x = 10.0
    robot.run(1)
    assert route(robot) == []


def test_a_place_exactly_half_a_metre_away_is_not_visited() -> None:
    robot = Robot(start())
    robot.x = 4.5
    assert reports(robot.run(1)) == []


def test_it_looks_twice_a_second() -> None:
    robot = Robot(start())
    robot.run(0.1)
    robot.x = 5.0
    assert [report.instant for report in reports(robot.run(2))] == [500_000]


def test_it_says_its_route_when_that_has_changed() -> None:
    robot = Robot(start())
    assert {d.route for _, d in robot.run(1)} == {None}
    robot.x = 5.0
    said = [d.route for _, d in robot.run(1) if d.route is not None]
    assert said == [(PlaceKey("r1", 1), PlaceKey("r1", 2))]


def test_without_places_it_stands() -> None:
    robot = Robot(start(places=()))
    decided = robot.run(3)
    assert goals(decided) == [] and reports(decided) == []


def test_a_goal_that_was_given_up_is_asked_for_again_after_a_pause() -> None:
    robot = Robot(start())
    robot.run(1)
    robot.goal = Goal(PLACES[0], GoalStatus.ABORTED, AbortReason.BLOCKED)
    assert goals(robot.run(2)) == []
    assert goals(robot.run(1)) == [(3_000_000, PLACES[0])]
    assert goals(robot.run(5)) == []
    robot.goal = Goal(PLACES[0], GoalStatus.ABORTED, AbortReason.BLOCKED)
    assert goals(robot.run(5)) == [(11_000_000, PLACES[0])]


def frames(decided: list[Decided]) -> list[tuple[int, bytes]]:
    return [(frame.instant, frame.data) for _, d in decided for frame in d.frames]


def test_it_publishes_once_a_second_at_a_phase_of_its_own() -> None:
    phases = set()
    for name in ("r1", "r2", "r3"):
        sent = frames(Robot(start(name)).run(5))
        assert len(sent) == 5
        instants = [instant for instant, _ in sent]
        assert {b - a for a, b in itertools.pairwise(instants)} == {1_000_000}
        phases.add(instants[0])
    assert len(phases) == 3
    assert frames(Robot(start()).run(5)) == frames(Robot(start()).run(5))


def test_what_it_publishes_is_what_it_knows() -> None:
    robot = Robot(start())
    assert published(robot) == Knowledge("r1", Point(0.0, 0.0), PLACES[0], WorkState.DRIVING)
    robot.goal = Goal(PLACES[0], GoalStatus.ABORTED, AbortReason.NO_PLAN)
    assert published(robot).state is WorkState.BLOCKED
    for x in (5.0, 10.0, 2.0):
        robot.x = x
        robot.run(1)
    assert published(robot) == Knowledge("r1", Point(2.0, 0.0), None, WorkState.IDLE)


def published(robot: Robot) -> Knowledge:
    ((_, data),) = frames(robot.run(1))
    knowledge = unpack(data)
    assert knowledge is not None
    return knowledge


def test_the_tags_of_its_frames_differ() -> None:
    tags = [frame.tag for _, d in Robot(start()).run(20) for frame in d.frames]
    assert len(set(tags)) == len(tags) == 20


def test_it_counts_what_it_hears_and_takes_no_notice() -> None:
    robot, deaf = Robot(start()), Robot(start())
    other = pack(Knowledge("r2", Point(1.0, 1.0), None, WorkState.IDLE))
    heard = [Heard(10, 2, -50.0, 200, data) for data in (other, b"\x00", other, b"\xff" * 118, other)]
    assert robot.run(1, *heard, Overflow(20, 1)) == deaf.run(1)
    assert (robot.baseline.heard, robot.baseline.junk) == (3, 2)


def test_after_a_freeze_it_goes_on_without_catching_up() -> None:
    robot = Robot(start())
    robot.run(1)
    robot.now += 60_000_000
    assert len(frames(robot.run(2))) == 2


def test_after_a_restart_it_begins_anew() -> None:
    robot = Robot(start(epoch=1))
    robot.now = 73_200_000
    assert goals(robot.run(1)) == [(73_500_000, PLACES[0])]


def test_the_strategy_none_leads_here() -> None:
    assert isinstance(load_behaviour(STRATEGIES["none"], start()), Baseline)
    assert isinstance(behaviour(start()), Baseline)
