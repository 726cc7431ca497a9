"""Logs in folders and in any frame, and our filter beside another one that was fed with them."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actors.geometry import Pose
from benchmarks.localisation import log, logs
from benchmarks.localisation.course import CourseSetup
from benchmarks.localisation.log import CourseLogError
from benchmarks.localisation.logs import Other, OtherRun
from tests.localisation_bench.scenes import CORRIDOR, course
from tests.localisation_bench.test_metrics import a_run

SHORT = CourseSetup(CORRIDOR, 2, base="kobuki", seconds=8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two logs, and beside them what another one made of them."""
    made = tmp_path / "logs"
    made.mkdir()
    for name in ("a", "b"):
        log.write(made / f"{name}.zip", course(SHORT))
    told = [{"log": name, "runs": [_run(0.04), _run(0.06)]} for name in ("a", "b", "unused")]
    (tmp_path / "other.json").write_text(json.dumps(told))
    return made


def _run(rmse: float) -> dict[str, object]:
    return {"rmse": rmse, "lost": False, "nmed": 0.2, "updates": 12}


def test_a_folder_of_logs_is_compared_log_by_log(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = logs.check(folder, 2, folder.parent / "other.json")
    figures = found.figures
    assert set(figures) == {"logs", "against"} and json.dumps(figures)
    rows = {(row["preset"], row["log"]): row for row in figures["against"]}
    assert set(rows) == {(p, name) for p in ("chapter", "robust") for name in ("a", "b", "all 2")}
    row = rows["robust", "a"]
    ours = np.mean([run["rmse"] for run in figures["logs"]["a"]["robust"]])
    assert row["ours"] == pytest.approx(ours) and row["theirs"] == pytest.approx(0.05)
    assert row["ratio"] == pytest.approx(ours / 0.05) and row["low"] <= row["ratio"] <= row["high"]
    assert row["lost"] == "0/2, 0/2" and row["nees"].endswith(", 0.20")
    assert rows["robust", "all 2"]["ratio"] == pytest.approx(row["ratio"])
    ratio = rows["chapter", "all 2"]["ratio"]
    assert found.holds == (ratio <= 1 and not any(run["lost"] for run in figures["logs"]["a"]["chapter"]))
    logs.check(folder, 1, folder.parent / "other.json").show()
    printed = capsys.readouterr().out
    assert "beside another localisation" in printed and "all 2" in printed
    logs.check(folder).show()
    assert capsys.readouterr().out.count("odometry") == 2


def a_table(ours: Sequence[float], theirs: Sequence[float]) -> list[logs.PairedRow]:
    other = Other("x", [OtherRun(rmse, lost=rmse > 1) for rmse in theirs])
    return logs.paired({"x": {"p": [a_run([value] * 3) for value in ours]}}, {"x": other})


def test_the_interval_of_a_ratio_is_that_of_its_runs() -> None:
    (clear,) = a_table([0.02, 0.021, 0.019, 0.02], [0.04, 0.041, 0.039, 0.04])
    assert clear.ratio == pytest.approx(0.5, rel=1e-6) and clear.high < 0.53
    (open_,) = a_table([0.02, 2.0], [0.04, 0.05, 1.5])
    assert open_.low < 0.1 and open_.high > 10
    assert (open_.lost, open_.nees) == ("1/2, 1/3", "2.00, -")


@pytest.mark.parametrize("preset", ["chapter", "robust", "odometry"])
def test_odometry_may_begin_anywhere(tmp_path: Path, preset: str) -> None:
    here = course(SHORT)
    frame = Pose(-700.0, 3000.0, 2.5)
    moved = np.array([frame.compose(Pose(*pose)) for pose in here.odometry.tolist()])
    log.write(tmp_path / "moved.zip", replace(here, odometry=moved))
    log.write(tmp_path / "same.zip", here)
    there, same = (logs.check(tmp_path / name, 3).figures for name in ("moved.zip", "same.zip"))
    rmse = [np.mean([run["rmse"] for run in figures[preset]]) for figures in (there, same)]
    assert rmse[0] == pytest.approx(rmse[1], rel=0.3, abs=1e-6) and rmse[0] < 0.1


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{", "must be a list of logs, each with its runs"),
        ("[[[[", "must be a list of logs"),
        ('[{"log": "a"}]', "must be a list of logs, each with its runs .*runs"),
        ('[{"log": "a", "runs": []}]', "a: must have runs, each with an rmse above 0"),
        ('[{"log": "a", "runs": [{"rmse": -1, "lost": false}]}]', "a: must have runs, each with an rmse"),
        ('[{"log": "a", "runs": [{"rmse": 1, "lost": false}]}]', "says nothing of the log 'b'"),
    ],
)
def test_what_another_one_made_is_checked(folder: Path, content: str, sentence: str) -> None:
    wrong = folder.parent / "wrong.json"
    wrong.write_text(content)
    with pytest.raises(CourseLogError, match=sentence) as caught:
        logs.check(folder, 1, wrong)
    assert str(caught.value).startswith(str(wrong)) and "\n" not in str(caught.value)


def test_a_folder_without_logs_and_a_missing_file_are_named(tmp_path: Path) -> None:
    with pytest.raises(CourseLogError, match=r"this folder holds no log, which would be a \*\.zip"):
        logs.check(tmp_path)
    with pytest.raises(CourseLogError, match=r"other\.json: cannot be read: No such file"):
        logs.check(tmp_path, 1, tmp_path / "other.json")
