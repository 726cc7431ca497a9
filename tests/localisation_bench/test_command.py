import json
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from benchmarks.localisation import command, logs
from benchmarks.localisation.cells import CellError, Extent, cells, chosen
from benchmarks.localisation.log import CourseLogError
from benchmarks.localisation.runs import update_costs
from tests.localisation_bench.scenes import APARTMENT, CORRIDOR

SMALL = Extent(seeds=1, runs=2, seconds=5, after=(1.0, 3.0), carried_at=2.0)


def test_the_cells_are_those_that_were_asked_for() -> None:
    everything = cells(CORRIDOR, [APARTMENT], Extent())
    names = [cell.name for cell in everything]
    assert len(set(names)) == len(names)
    tracking = {name for name in names if name.startswith("tracking/")}
    assert tracking == {
        f"tracking/corridor/{view}/{base}/{robots}/{preset}"
        for view in ("360", "58")
        for base in ("exact", "kobuki")
        for robots in (0, 4, 10)
        for preset in ("chapter", "robust")
    }
    goals = {cell.name: (cell.goal.rmse, cell.goal.lost, cell.runs) for cell in everything if cell.goal}
    assert goals == {
        "alone/corridor/360/exact/0/chapter": (0.08, 0.0, 100),
        "alone/corridor/360/exact/0/robust": (0.08, 0.0, 100),
        "realistic/corridor/360/kobuki/4-at-times/robust": (0.15, 0.0, 100),
        "crowd/corridor/360/kobuki/10/robust": (None, 0.05, 20),
        "crowd/corridor/58/kobuki/10/robust": (None, 0.05, 20),
        "crowd/apartment/360/kobuki/10/robust": (None, 0.05, 20),
        "crowd/apartment/58/kobuki/10/robust": (None, 0.05, 20),
    }
    assert "range/corridor/360-as-written/kobuki/4/robust" in names
    assert "causes/corridor/58/exact/0/chapter/map_error-0.1" in names
    assert all(cell.runs == 20 for cell in everything if cell.section not in ("alone", "realistic"))
    for section in ("global", "kidnapped"):
        its = [cell for cell in everything if cell.section == section]
        kinds = {(cell.course.plan, cell.arm.preset, cell.arm.recovery) for cell in its}
        assert len(its) == len(kinds) == 8


def test_cells_are_chosen_by_section_or_pattern() -> None:
    everything = cells(CORRIDOR, [APARTMENT], Extent())
    assert {cell.section for cell in chosen(everything, ["mask", "alone"])} == {"mask", "alone"}
    assert [cell.name for cell in chosen(everything, ["mask/*/58/*/2/robust/on"])] == [
        "mask/corridor/58/kobuki/2/robust/on"
    ]
    assert chosen(everything, []) == everything
    with pytest.raises(CellError, match="no cell is called 'masks'; right is one of alone, "):
        chosen(everything, ["masks"])


def test_the_figures_of_every_seed_are_told() -> None:
    patterns = ["alone", "global/corridor/*", "kidnapped/apartment/*/recovery"]
    found = command.measured(patterns, SMALL, workers=1)
    figures = found.figures
    assert json.dumps(figures, allow_nan=False)
    assert found.holds == all(cell["goal"]["reached"] for cell in figures["cells"] if cell["goal"])
    told = {cell["cell"]: cell for cell in figures["cells"]}
    assert len(told) == 2 + 4 + 2
    alone = told["alone/corridor/360/exact/0/robust"]
    assert [run["seed"] for run in alone["runs"]] == [1, 2] and alone["found"] is None
    assert alone["goal"]["reached"] == (alone["summary"]["rmse"] <= 0.08)
    assert all(run["updates"] == run["outcome"]["updates"] > 3 for run in alone["runs"])
    lost = told["global/corridor/360/kobuki/0/chapter/no-recovery"]
    assert lost["runs"][0]["median"] > 0.5 and [share["of"] for share in lost["found"]] == [1, 1]
    assert figures["updates"] == []


def test_tables_and_goals_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    patterns = [
        "realistic",
        "mask/*/360/*/2/robust",
        "kidnapped/apartment",
        "causes/*/360/exact/0/robust/*",
        "crowd/apartment/58",
    ]
    command.measured(patterns, SMALL, workers=1).show()
    printed = capsys.readouterr().out
    titles = "realistic: four others near", "mask: peers' positions told", "kidnapped: carried"
    for title in (*titles, "causes: one at a time", "map_error 0.1", "furniture 30", "crowd: ten others"):
        assert title in printed
    assert "goal, crowd/apartment/58/kobuki/10/robust: at most 5% lost: " in printed
    goal = "goal, realistic/corridor/360/kobuki/4-at-times/robust: rmse ≤ 0.15 m and none lost: "
    assert goal in printed and "(with 2 runs only; 100 are asked for)" in printed


def test_a_course_is_written_and_fed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "course.zip"
    (said,) = command.write_log(file, ["tracking/*/4/chapter"], 7, SMALL).shown
    assert "the course of tracking/corridor/360/exact/4/chapter, seed 7: 51 poses, 51 scans" in str(said)
    found = logs.check(file, seeds=2)
    figures = found.figures
    found.show()
    printed = capsys.readouterr().out
    assert "course" in printed and all(name in printed for name in ("chapter", "robust", "odometry"))
    assert [len(runs) for runs in figures.values()] == [2, 2, 2]
    assert figures["odometry"][0]["max"] < 1e-6  # this odometry is exact
    direct = command.measured(["tracking/corridor/360/exact/4/chapter"], Extent(7, 1, 5), workers=1)
    assert direct.holds is None, "a cell without a goal"
    assert direct.figures["cells"][0]["runs"][6]["seed"] == 7


def test_the_cost_of_an_update_is_measured_with_exactly_500_particles_and_60_beams() -> None:
    chapter, robust = update_costs(CORRIDOR, repeats=1, seconds=6)
    assert (chapter.preset, robust.preset) == ("chapter", "robust")
    for cost in (chapter, robust):
        assert cost.updates == 10 and 0 < cost.min_us <= cost.mean_us
        assert cost.goal_met == (cost.min_us <= 150)


def test_what_excludes_one_another_is_refused_and_a_damaged_log_named(tmp_path: Path) -> None:
    file = tmp_path / "course.zip"
    command.check(log=file, cell=["alone"], duration=4, seed=3)
    assert set(command.check(source=file, runs=1).figures) == {"chapter", "robust", "odometry"}
    with pytest.raises(OptionError, match="--log: is another thing to do than --from; give one of them"):
        command.check(log=file, source=file)
    with pytest.raises(OptionError, match="--against: needs --from, the logs to compare on"):
        command.check(against=file)
    file.write_text("damaged")
    with pytest.raises(CourseLogError):
        command.check(source=file)
