"""That both checks run, count what there is, and give the same whoever computes it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.navigation import navigation
from benchmarks.navigation.course import NavigationCourse, scenario
from benchmarks.navigation.run import Leg, RunFigures, measure, no_trajectory_s
from benchmarks.statistics.measured import Measured
from observation.results.navigation_result import NavigationOutcome

MAPS = Path(__file__).parents[2] / "maps"
MAZE = MAPS / "maze.yaml"


def test_a_course_is_drawn_from_its_seed() -> None:
    course = NavigationCourse(MAZE, 2, 3, 1)
    assert scenario(course) == scenario(course)
    assert scenario(course).robot != scenario(NavigationCourse(MAZE, 2, 3, 2)).robot
    assert [len(robot.places or ()) for robot in scenario(course).robot] == [3, 3]
    assert scenario(course).localisation == {} == scenario(course).navigation
    other = scenario(NavigationCourse(MAZE, 2, 3, 1, "odometry", "robust"))
    assert (other.localisation, other.navigation) == ({"preset": "odometry"}, {"preset": "robust"})
    assert other.robot == scenario(course).robot, "the same course"


def test_one_robot_reaches_what_it_is_sent_to() -> None:
    figures = measure(NavigationCourse(MAZE, 1, 1, 1, localisation="odometry"))
    assert [leg.how for leg in figures.legs] == ["succeeded"]
    for leg in figures.legs:
        assert leg.shortest is not None and leg.shortest > 0.1
        assert leg.seconds > leg.shortest / navigation.SPEED - 1.0, "faster than the body can"
    assert figures.wall_contacts == figures.robot_contacts == figures.contacts == 0
    assert figures.wall_gap > 0
    assert figures.no_trajectory_s is not None and figures.no_trajectory_s < figures.robot_hours * 3600


def test_navigation_is_the_same_in_one_process_and_in_two() -> None:
    task = navigation.NavigationTask((MAZE,), (2,), goals=4, runs=2, localisation="odometry", workers=1)
    (alone,) = navigation.measured(task)
    assert alone.goals == 4 and len(set(alone.digests)) == 2
    assert alone.succeeded + sum(alone.aborted.values()) + alone.unfinished == 4
    assert navigation.measured(replace(task, workers=2)) == [alone]
    (second,) = navigation.measured(replace(task, seed=2, runs=1, goals=2))
    assert second.digests == alone.digests[1:], "runs have the seeds from the task's on"


def test_the_claim_on_navigation_is_about_walls() -> None:
    found = navigation.check((MAZE,), (1,), goals=1, runs=1, localisation="odometry")
    assert found.holds and found.figures[0]["wall_contacts"] == 0
    assert str(found.shown[-1]).endswith("; goal, no contact with a wall: met")


def run_without(no_trajectory_s: float | None, robot_hours: float) -> RunFigures:
    leg = Leg("blocked", 3.0, None)
    return RunFigures((leg,), robot_hours, no_trajectory_s, 0, 0, 0, 0.1, 0.2, "digest")


def summed(monkeypatch: pytest.MonkeyPatch, *runs: RunFigures) -> Measured:
    monkeypatch.setattr(navigation, "in_order", lambda work, tasks, workers: runs)
    return navigation.check((MAZE,), (1,), goals=len(runs), runs=len(runs))


def test_the_time_without_a_trajectory_is_a_share_of_all_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = summed(monkeypatch, run_without(360.0, 0.5), run_without(0.0, 0.3), run_without(144.0, 0.2))
    (one,) = found.figures
    assert one["no_trajectory"] == pytest.approx(0.14)
    low, high = one["no_trajectory_95"]
    # by hand: residuals 0.03, -0.042, 0.012 h by 1/3 h; their deviation 0.1124 by sqrt 3, t(2) = 4.303
    assert (low, high) == (0.0, pytest.approx(0.14 + 0.2792, abs=1e-4))
    assert json.loads(json.dumps(one))["no_trajectory_95"] == [low, high]
    found.show()
    assert capsys.readouterr().out.count("│ 14.0%         │ 0.0% to 41.9% │") == 1


def test_one_run_says_nothing_of_how_runs_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    (one,) = summed(monkeypatch, run_without(36.0, 0.1)).figures
    assert (one["no_trajectory"], one["no_trajectory_95"]) == (pytest.approx(0.1), (0.0, 1.0))


def test_a_run_whose_time_is_not_known_leaves_the_share_unknown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = summed(monkeypatch, run_without(36.0, 0.1), run_without(None, 0.1))
    assert [found.figures[0][key] for key in ("no_trajectory", "no_trajectory_95")] == [None, None]
    found.show()
    assert capsys.readouterr().out.count("│ -             │ -    │") == 1


def test_spells_that_are_not_listed_leave_the_time_without_a_trajectory_unknown() -> None:
    def said(*spells: tuple[int, int], unlisted: int = 0) -> NavigationOutcome:
        listed = tuple((begin, end, "itself") for begin, end in spells)
        return NavigationOutcome(1, 0, 0, 0, 0, {}, listed, unlisted)  # type: ignore[arg-type]

    both = [said((0, 1_000_000), (3_000_000, 3_500_000)), said((2_000_000, 4_000_000))]
    assert no_trajectory_s(both) == 3.5
    assert no_trajectory_s([*both, said((0, 1), unlisted=1)]) is None
