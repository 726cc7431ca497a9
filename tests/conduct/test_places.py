"""Reports of places: outcomes and the end of the run."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.installation.repository import REPOSITORY
from actors.instant import Instant
from actors.items import ItemGivenUp, ItemKey, TaskReports
from actors.message_limits import OrderLimits
from actors.messages import SensorData
from actors.orders import Freeze, ItemAssignment, Kill, Obstacle, Order, Restart, Thaw
from actors.runtime.errors import AcrcError
from actors.settings import Settings
from actors.task.task import (
    Judge,
    JudgeSetup,
    Metric,
    Task,
    TaskDeclaration,
    TaskOutcome,
    TaskProgress,
)
from actors.user_code import FINDER, set_task_folders
from cleaning.place import VisitReport, points
from cleaning.referee import PlaceVerdict
from tests.conduct.scripted_swarm import ScriptedAnswer, ScriptedSwarm
from tests.refusals import refused

R1, R2 = ItemKey("r1", 0), ItemKey("r2", 0)


def reported(key: ItemKey, instant: int = 700_000) -> ScriptedAnswer:
    return ScriptedAnswer(reports=(VisitReport(key.owner, key.number, instant),))


def given_up(key: ItemKey, instant: int = 700_000) -> ScriptedAnswer:
    return ScriptedAnswer(given_up=(ItemGivenUp(key.owner, key.number, instant, "the door is shut"),))


def test_the_run_ends_when_every_place_is_reported_or_given_up() -> None:
    play = ScriptedSwarm(60.0)
    play.acts["r1"].says = {3: reported(R1, 300_000), 7: given_up(R2)}  # whoever it belongs to
    play.run()
    assert play.core.step == 8 and play.progress[-1].finished
    assert [place.verdict for place in play.places] == [PlaceVerdict.MISTAKEN, PlaceVerdict.GIVEN_UP]
    assert (play.places[1].given_up_by, play.places[1].reason) == ("r1", "the door is shut")


def test_robots_without_goals_do_not_end_the_run() -> None:
    play = ScriptedSwarm(2.0)
    for act in play.acts.values():
        act.says = {3: ScriptedAnswer(route=())}
    assert play.run().core.step == 20
    assert [place.verdict for place in play.places] == [PlaceVerdict.LOST] * 2
    assert [play.progress[0].left, play.progress[-1].left] == [0, 0]
    play = ScriptedSwarm(1.0, places=())
    assert play.run().core.step == 10
    assert play.places == ()


@pytest.mark.parametrize(
    ("event", "last"), [((2.0, Obstacle(25.0, 12.0, 0.2)), 20), ((0.4, Restart("r2")), 5)]
)
def test_a_run_waits_for_events_and_restarted_robots(event: tuple[float, Order], last: int) -> None:
    play = ScriptedSwarm(5.0, [event])
    play.acts["r1"].says = {
        3: ScriptedAnswer(given_up=(*given_up(R1, 399_999).given_up, *given_up(R2, 300_000).given_up))
    }
    assert play.run().core.step == last
    assert ("r2.1" in play.acts) == (last == 5)


def test_a_frozen_robot_keeps_its_places_and_a_killed_one_loses_them() -> None:
    play = ScriptedSwarm(2.0, [(1.0, Freeze("r1")), (1.0, Kill("r2"))]).run()
    r1, r2 = play.places
    assert (r1.in_route_of, r1.verdict) == (("r1",), PlaceVerdict.OPEN)
    assert (r2.in_route_of, r2.verdict) == ((), PlaceVerdict.LOST)
    assert play.progress[0].left == 2 and play.progress[-1].left == 1


def test_an_adopted_place_is_not_lost() -> None:
    play = ScriptedSwarm(2.0, [(1.0, Kill("r2"))])
    play.acts["r1"].says = {5: ScriptedAnswer(route=(R2, R1))}
    assert [place.in_route_of for place in play.run().places] == [("r1",), ("r1",)]
    play = ScriptedSwarm(2.0, [(1.0, Restart("r2"))])
    play.acts["r2"].says = {5: ScriptedAnswer(route=())}
    assert play.run().places[1].in_route_of == ("r2",)


@pytest.mark.parametrize(
    ("says", "act"),
    [
        (reported(ItemKey("r2", 1)), "reports place 1 of 'r2'"),
        (given_up(ItemKey("r9", 0)), "gives up place 0 of 'r9'"),
        (ScriptedAnswer(route=(R1, ItemKey("r1", -1))), "has in its route place -1 of 'r1'"),
    ],
)
def test_an_unknown_place_ends_the_run(says: ScriptedAnswer, act: str) -> None:
    play = ScriptedSwarm(2.0)
    play.acts["r1"].says = {7: says}
    with refused(f"step 7 (0.7 s): r1 {act}, which does not exist"):
        play.run()


HERE, THERE = (15.5, 12.5), (19.0, 12.5)


def told(senses: list[SensorData]) -> dict[int, tuple[tuple[float, float], ...]]:
    return {one.step: points(one.items) for one in senses if one.items}


def test_only_the_owner_gets_an_added_place_once() -> None:
    play = ScriptedSwarm(
        2.0, [(0.55, ItemAssignment("r1", (HERE, THERE))), (1.0, ItemAssignment("r1", (HERE,)))]
    ).run()
    assert told(play.acts["r1"].senses) == {6: (HERE, THERE), 10: (HERE,)}
    assert told(play.acts["r2"].senses) == {}
    mine = [place for place in play.places if place.owner == "r1"]
    assert [(one.number, one.x, one.given_at) for one in mine] == [
        (0, 15.0, 0), (1, 15.5, 600_000), (2, 19.0, 600_000), (3, 15.5, 1_000_000)
    ]  # fmt: skip
    assert [one.verdict for one in mine] == [PlaceVerdict.OPEN] * 4
    assert [one.owner for one in play.places] == ["r1"] * 4 + ["r2"]


def test_the_run_waits_for_added_places() -> None:
    play = ScriptedSwarm(9.0, [(2.0, ItemAssignment("r2", (HERE,)))])
    play.acts["r1"].says = {
        3: ScriptedAnswer(reports=(VisitReport("r1", 0, 300_000), VisitReport("r2", 0, 300_000)), route=()),
        29: ScriptedAnswer(reports=(VisitReport("r2", 1, 2_900_000),)),
    }
    play.acts["r2"].says = {3: ScriptedAnswer(route=())}
    play.run()
    assert play.core.step == 30
    left = {progress.instant: progress.left for progress in play.progress}
    assert (left[1_000_000], left[2_000_000], left[3_000_000]) == (0, 0, 1)
    assert play.places[-1].reported_at == 2_900_000


def test_a_place_is_reached_only_after_it_was_added() -> None:
    passed = ScriptedSwarm(
        9.0, [(8.0, ItemAssignment("r1", ((12.5, 13.0),)))], drive=lambda senses: (0.5, 0.0)
    ).run()
    (place,) = [one for one in passed.places if one.number == 1]
    assert (place.reached_at, place.given_at) == (None, 8_000_000)
    before = ScriptedSwarm(
        9.0, [(0.0, ItemAssignment("r1", ((12.5, 13.0),)))], drive=lambda senses: (0.5, 0.0)
    ).run()
    (place,) = [one for one in before.places if one.number == 1]
    assert place.reached_by == "r1"


def test_a_frozen_robot_gets_an_added_place_later_and_a_dead_one_never() -> None:
    play = ScriptedSwarm(
        2.0, [(0.5, Freeze("r1")), (0.8, ItemAssignment("r1", (HERE,))), (1.2, Thaw("r1"))]
    ).run()
    assert told(play.acts["r1"].senses) == {12: (HERE,)}
    play = ScriptedSwarm(2.0, [(0.5, Kill("r1")), (0.8, ItemAssignment("r1", (HERE,)))]).run()
    (place,) = [one for one in play.places if one.number == 1]
    assert (place.verdict, place.in_route_of) == (PlaceVerdict.LOST, ())


def test_a_restarted_robot_gets_all_added_places_again() -> None:
    events: list[tuple[float, Order]] = [
        (0.5, ItemAssignment("r2", (HERE,))),
        (1.0, Restart("r2")),
        (1.4, ItemAssignment("r2", (THERE,))),
    ]
    play = ScriptedSwarm(2.0, events)
    play.acts["r2"].says = {7: ScriptedAnswer(route=())}
    play.run()
    assert told(play.acts["r2"].senses) == {5: (HERE,)}
    assert told(play.acts["r2.1"].senses) == {10: (HERE,), 14: (THERE,)}
    assert [one.in_route_of for one in play.places if one.owner == "r2"] == [("r2",)] * 3


def test_a_robot_may_report_and_keep_an_added_place() -> None:
    play = ScriptedSwarm(2.0, [(0.5, ItemAssignment("r1", (HERE,)))])
    play.acts["r2"].says = {8: ScriptedAnswer(route=(ItemKey("r1", 1),))}
    assert play.run().places[1].in_route_of == ("r1", "r2")


def test_the_limit_of_places_fits_one_message() -> None:
    most = OrderLimits().items
    crowd = (HERE,) * most
    play = ScriptedSwarm(1.0, [(0.2, ItemAssignment("r1", crowd)), (0.5, Restart("r1"))]).run()
    assert told(play.acts["r1.1"].senses) == {5: crowd}
    with pytest.raises(AcrcError, match="the limit is 1000"):
        ScriptedSwarm(1.0, [(0.2, ItemAssignment("r1", crowd)), (0.5, ItemAssignment("r1", (HERE,)))]).run()


@pytest.fixture
def distance_task() -> Iterator[str]:
    folders = FINDER.task_folders
    set_task_folders((REPOSITORY,))
    yield f"{__name__}:DistanceTask"
    set_task_folders(folders)


class DistanceSettings(Settings, frozen=True):
    distance: float = 1000.0
    fish: str | None = None
    """Invalid reports of r2."""


class DistanceJudge(Judge):
    def __init__(self, setup: JudgeSetup) -> None:
        super().__init__()
        self._settings: DistanceSettings = setup.settings
        self._parted: int | None = None
        self.words: list[str] = []
        self.restarted: list[str] = []
        self.given: list[tuple[object, ...]] = []

    @property
    def settled(self) -> bool:
        return self._parted is not None

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        (ax, ay), (bx, by) = positions.tolist()
        if self._parted is None and (ax - bx) ** 2 + (ay - by) ** 2 >= self._settings.distance**2:
            self._parted = instant

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        self.words.append(robot)
        return self._settings.fish if robot == "r2" else None

    def restart(self, robot: str) -> None:
        self.restarted.append(robot)

    def give(self, instant: Instant, robot: str, items: Sequence[object]) -> str | None:
        self.given.append((robot, *items))
        return None

    def progress(self, present: Collection[str]) -> TaskProgress:
        return TaskProgress(0, 1) if self.settled else TaskProgress(len(present), 0)

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        return TaskOutcome("drove", {"parted_at": self._parted}, {"r1": {}, "r2": {}})


class DistanceTask(Task):
    declaration = TaskDeclaration(
        name="distance",
        table="distance",
        item="item",
        items="items",
        done="done",
        metrics=(Metric("parted", "time until the robots are apart", "µs", "parted_at", "less", rank=1),),
    )
    settings = DistanceSettings

    def judge(self, setup: JudgeSetup) -> DistanceJudge:
        return DistanceJudge(setup)


def distance_run(
    task: str, seconds: float, events: Sequence[tuple[float, Order]] = (), **settings: object
) -> tuple[ScriptedSwarm, DistanceJudge]:
    play = ScriptedSwarm(seconds, events, task=task, settings=settings)
    for act in play.acts.values():
        act.says = {step: ScriptedAnswer(route=()) for step in range(10)}
    judge = play.run().judge
    assert isinstance(judge, DistanceJudge)
    return play, judge


def test_a_run_ends_once_another_task_is_settled_or_at_its_limit(distance_task: str) -> None:
    play, judge = distance_run(distance_task, 20.0, distance=0.5)
    assert play.core.finished and play.core.step == 0, "the robots are far enough apart"
    assert play.core.task_outcome.values == {"parted_at": 0}
    assert (play.progress[-1].left, play.progress[-1].done) == (0, 1)
    assert judge.words == []
    play, judge = distance_run(distance_task, 1.0)
    assert int(play.core.instant) == 1_000_000 and play.core.task_outcome.values == {"parted_at": None}
    assert judge.words == ["r1", "r2"] * play.core.step


def test_a_task_receives_restarts_and_items_and_can_end_the_run(distance_task: str) -> None:
    with refused("step 0 (0 s): r2 says that it is a fish"):
        distance_run(distance_task, 1.0, fish="says that it is a fish")
    events: list[tuple[float, Order]] = [(0.5, Restart("r2")), (0.6, ItemAssignment("r1", ((15.5, 12.5),)))]
    _, judge = distance_run(distance_task, 1.0, events)
    assert (judge.restarted, judge.given) == (["r2"], [("r1", (15.5, 12.5))])
