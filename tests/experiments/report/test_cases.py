"""What a report is made from: campaigns, single runs, and what real robots have recorded."""

import html
from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.runtime.errors import AcrcError
from experiments.report import report
from experiments.report.cases import REAL, read
from experiments.study.study import Factor, Study, Trial
from observation.field_trial.trial_result import RobotTrial, TrialResult
from observation.results.result import RunResult
from tests.experiments.report.made_up import campaign


def field_trial(plain: RunResult) -> TrialResult:
    frames = {"frames_handed": 9, "frames_sent": 8, "copies_heard": 20, "bytes_sent": 400}
    robot = RobotTrial(10, None, 7, 0, None, 7, 0, frames, None, None, None, (), ())
    return TrialResult(
        robots=1, duration_s=300.0, places_total=10, places_done=None, places_claimed=7, places_given_up=0,
        places_lost=0, completion_s=None, settled_s=None, last_reached_s=250.0, per_robot={"r1": robot},
        contacts=None, frames=frames, radio_bytes_per_robot_s=1.333, deeco=plain.deeco, reference="r1",
        notes=("r2: no frame connects its clock",), out=None,
    )  # fmt: skip


def put(folder: Path, name: str, result: RunResult | TrialResult) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True)
    path.write_bytes(msgspec.json.encode(result))
    return folder


def drawn(trial: Trial, rng: np.random.Generator) -> tuple[int, float | None]:
    return 30, None


def test_real_robots_stand_beside_a_run_and_what_nobody_knows_is_said(
    plain: RunResult, tmp_path: Path
) -> None:
    real = put(tmp_path / "friday", "run.json", field_trial(plain))
    run = put(tmp_path / "simulated", "result/run.json", plain)
    sources = read([real, run])
    assert [one.cases[0].condition for one in sources] == [REAL, "one scenario, 1 robots, 1 s"]
    assert [one.cases[0].strategy for one in sources] == ["friday", "chapter"]
    page = report.write([real, run], tmp_path / "out").read_text()
    assert "Of real robots nobody knows the truth: places are as they reported them" in page
    assert "friday: r2: no frame connects its clock." in page
    assert "2 of the folders hold one run each" in page
    assert "Real robots' places are those that they reported" in html.unescape(page)
    assert "Nothing was compared." in page


def test_variants_are_conditions_and_so_are_campaigns(plain: RunResult, tmp_path: Path) -> None:
    study = Study("chapter", "/s.toml", ("none",), 1, factors=(Factor("robots.count", (4, 8)),))
    one = campaign(tmp_path / "one", plain, study, drawn)
    other = campaign(tmp_path / "x" / "one", plain, Study("chapter", "/s.toml", ("none",), 1), drawn)
    alone = [case.condition for case in read([one])[0].cases]
    assert alone == ["robots.count = 4", "robots.count = 8"]
    assert [[case.condition for case in source.cases] for source in read([one, other])] == [
        ["one: robots.count = 4", "one: robots.count = 8"],
        ["one-2"],
    ]


def test_a_folder_that_holds_nothing_is_named(tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match="holds neither a campaign nor the result of a run"):
        read([tmp_path])
    (tmp_path / "run.json").write_text('{"digest": 3}')
    with pytest.raises(AcrcError, match=r"run\.json: no result of a run: digest is 3, but must be a text"):
        read([tmp_path])
