"""That both checks run, count what there is, and give the same whoever computes it."""

from dataclasses import replace
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from benchmarks.failures import failures
from benchmarks.navigation import navigation
from benchmarks.navigation.course import NavigationCourse, scenario
from benchmarks.navigation.run import measure
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.results.result import RunResult

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


def plain_run(seed: int, out: Path) -> RunResult:
    overrides = Overrides(robots=4, seed=seed, duration=5.0, strategy="none")
    plan = swarm.plan(load_scenario(failures.SCENARIO, overrides), RunOptions(out, bus="memory"))
    return swarm.run_in_memory(plan, lambda progress: None)


def test_failures_are_counted_in_the_runs_that_acrc_would_make(tmp_path: Path) -> None:
    checked = failures.check(robots=(4,), runs=2, duration=5.0, workers=1)
    found = checked.figures
    assert not checked.holds, "none comes about in 5 s"
    assert [(one["robots"], one["seed"], one["simulated_s"], one["places"]) for one in found] == [
        (4, 1, 5.0, 40),
        (4, 2, 5.0, 40),
    ]
    plain = [plain_run(seed, tmp_path / str(seed)) for seed in (1, 2)]
    assert [one["digest"] for one in found] == [one.digest for one in plain], "to look on changes nothing"
    for one, same in zip(found, plain, strict=True):
        assert one["left"] == same.places_total - same.places_done and one["goals"] >= 4
        assert one["lost_share"] is not None and not one["blockings"], "no window of 30 s in a run of 5 s"


def test_failures_print_a_rate_and_an_interval_for_each(capsys: pytest.CaptureFixture[str]) -> None:
    failures.check(robots=(2,), runs=2, duration=2.0).show()
    printed = capsys.readouterr().out
    assert "strategy none, robots 2, 2 seeds" in printed
    for name in ("robots lost", "no valid trajectory", "mutual blocking", "goals aborted", "places left"):
        assert name in printed
    assert "places left: 40 of 40" in printed


def test_a_preset_that_there_is_not_is_refused() -> None:
    with pytest.raises(OptionError, match=r'localisation.preset is "none", but must be'):
        failures.check(robots=(2,), runs=1, duration=2.0, localisation="none", workers=1)
