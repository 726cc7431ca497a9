"""Studies of a task that is not cleaning: metrics, sentences, tables, report, and loading of the task."""

import csv
import html
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from acrc_testbed.experiments import campaign, store, trial_program
from acrc_testbed.experiments.evaluation import evaluate, summary_sentences
from acrc_testbed.experiments.metrics import task_metrics
from acrc_testbed.experiments.report import report_page
from acrc_testbed.experiments.report.report_view import read_sources
from acrc_testbed.experiments.study import Study, load_study
from acrc_testbed.experiments.trial_record import TrialRecord, make_order, validated_record, write_json
from acrc_testbed.experiments.trial_settings import StudyOptions, check_study, make_study
from acrc_testbed.experiments.verdicts import ceiling_sentences
from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.code_permit import permit_of
from actors.runtime.errors import AcrcError
from actors.task.task import Metric, TaskDeclaration
from actors.user_code import FINDER
from tests.experiments.made_runs import CLEANING

DELIVERY = TaskDeclaration(
    name="delivery",
    table="orders",
    item="order",
    items="orders",
    done="delivered",
    metrics=(
        Metric(
            "delivered", "delivered orders", "orders", "delivered", rank=1, worst=0.0, margin=1.0, total="all"
        ),
        Metric("late", "late orders", "orders", "late", "less", rank=2, worst=9.0, margin=1.0),
        Metric("first", "time to the first order", "s", "first_s", "less", "started"),
        Metric("queue", "time in queues", "s", "queue_s", "less"),
    ),
)
STUDY = Study(name="orders", task=DELIVERY, scenario="/s.toml", strategies=("greedy", "auction"), seeds=8)


def result(plain: RunResult, seed: int, strategy: str) -> RunResult:
    values = {
        "delivered": 8, "all": 10, "late": 1 + 3 * (strategy == "greedy") + seed % 2,
        "first_s": None if seed == 1 else 20.0 + seed, "queue_s": 5.0 * seed,
    }  # fmt: skip
    robots = {name: msgspec.structs.replace(one, task={}) for name, one in plain.per_robot.items()}
    return msgspec.structs.replace(
        plain, seed=seed, simulated_s=100.0, task=values, declaration=DELIVERY, per_robot=robots
    )


@pytest.fixture
def kept(tmp_path: Path, plain: RunResult) -> store.Store:
    """Return a campaign in which both strategies deliver as many orders, and greedy more of them late."""
    made = store.create_store(tmp_path / "orders", STUDY)
    for trial in STUDY.trials():
        run = result(plain, trial.seed, trial.strategy)
        record = TrialRecord(trial.strategy, trial.seed, {}, run)
        if (trial.strategy, trial.seed) == ("greedy", 8):
            record = TrialRecord(trial.strategy, trial.seed, {}, failure="it rained")
        write_json(made.path(trial), record)
    return made


def test_the_metrics_of_a_task_decide_in_their_order(kept: store.Store) -> None:
    found = evaluate(with_study(kept, failed_runs="left out"))
    (verdict,) = found.verdicts
    assert [step.metric for step in verdict.steps] == ["delivered", "late"] and verdict.label == "better"
    (told,) = [line for line in found.sentences() if line.startswith("auction and greedy are equivalent")]
    assert told.startswith("auction and greedy are equivalent in delivered orders within 1 order: 8 versus 8")
    assert (
        "Therefore they are compared in late orders: auction is better than greedy in late orders: " in told
    )
    assert [one.metric for one in found.estimates][:6] == [
        "delivered", "late", "first", "queue", "lexicographic", "contacts",
    ]  # fmt: skip
    assert evaluate(kept).failures == [
        "greedy failed in 1 of 8 runs (seed 8); each counts as a run with delivered = 0, late = 9"
    ]
    assert next(summary_sentences(kept.records())) == (
        "greedy: 56 of 70 delivered orders, mean late orders 4.571, started in 6 of 7 runs, half of the runs "
        "by 25.0 s, mean time in queues 20, 0 contacts"
    )
    assert "places" not in " ".join((*found.sentences(), *evaluate(kept).sentences()))


def with_study(kept: store.Store, **words: object) -> store.Store:
    """Return the campaign with other fields of the study."""
    return store.Store(kept.folder, msgspec.structs.replace(kept.study, **words))


def test_the_largest_possible_value_is_a_ceiling(kept: store.Store, plain: RunResult) -> None:
    assert not list(ceiling_sentences(kept.records(), STUDY))
    full = [
        TrialRecord("a", seed, {}, varied_task(result(plain, seed, "a"), delivered=10)) for seed in range(4)
    ]
    (told,) = ceiling_sentences(full, STUDY)
    assert told.startswith("4 of 4 runs have the largest possible value of delivered orders (ceiling effect)")


def varied_task(run: RunResult, **values: int) -> RunResult:
    return msgspec.structs.replace(run, task=run.task | values)


def test_tables_and_report_have_the_values_of_the_task(kept: store.Store, tmp_path: Path) -> None:
    campaign.write_tables(kept)
    (first, *_) = rows(kept.folder / "results.csv")
    assert (first["delivered"], first["late"], first["first_s"]) == ("8", "5", "")
    assert "places_done" not in first and not any(name.startswith(("task", "declaration")) for name in first)
    page = html.unescape(report_page.write([kept.folder], tmp_path / "report").read_text())
    for told in (
        "Delivered orders",
        "Late orders",
        "Time to the first order: share",
        "time in queues, s",
    ):
        assert told in page, told
    assert "place" not in page and "Results by robot" not in page
    shares = {row["strategy"]: row["started"] for row in rows(tmp_path / "report" / "first.csv")}
    assert shares == {"greedy": "6", "auction": "7"}
    assert {row["total"] for row in rows(tmp_path / "report" / "delivered.csv")} == {"10"}


def rows(path: Path) -> Sequence[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_runs_of_different_tasks_are_not_compared(
    kept: store.Store, plain: RunResult, tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_bytes(msgspec.json.encode(plain))
    with pytest.raises(AcrcError) as caught:
        read_sources([kept.folder, tmp_path])
    assert str(caught.value) == (
        f"{tmp_path}: its runs are of the task cleaning, those of {kept.folder} of delivery; write a report "
        "for each task"
    )
    trial = next(STUDY.trials())
    content = msgspec.json.encode(TrialRecord("greedy", 1, {}, msgspec.structs.replace(plain, seed=1)))
    assert validated_record(content, trial, CLEANING, "").failure is None
    refused = validated_record(content, trial, DELIVERY, "").failure
    assert refused == "its run had another task than delivery, or another version of it"


TASK = """
from msgspec.structs import replace
from cleaning.task import CleaningTask

class Mine(CleaningTask):
    declaration = replace(CleaningTask.declaration, name="mine", metrics=CleaningTask.declaration.metrics[:1])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a study with a scenario of the user's task."""
    monkeypatch.setattr(FINDER, "folders", ())
    monkeypatch.setattr(FINDER, "task_folders", ())
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "mine_of_studies.py").write_text(TASK)
    scenario = (REPOSITORY / "scenarios" / "corridor.toml").read_text()
    scenario = scenario.replace("../maps/", f"{REPOSITORY}/maps/")
    (tmp_path / "s.toml").write_text(f'{scenario}\n[task]\nuse = "mine_of_studies:Mine"\n')
    (tmp_path / "study.toml").write_text(
        'scenario = "s.toml"\nstrategies = ["none"]\nseeds = 1\nmargins = {places = 3}\n'
        '[set]\n"robots.count" = 1\n"run.duration" = 1\n'
    )
    return tmp_path


def test_a_task_is_loaded_from_folders_of_the_command_line(folder: Path, tmp_path: Path) -> None:
    path = folder / "study.toml"
    with pytest.raises(AcrcError, match="its module is not installed; name its folder with --modules DIR"):
        load_study(path)
    permit = permit_of([folder / "code"])
    study = make_study(StudyOptions(path))
    assert study.task.name == "mine" and [*study.metrics()][:2] == ["places", "lexicographic"]
    assert study.metrics()["places"].margin == 3.0
    _, folders = check_study(study, permit, path)
    assert folders.tasks == (folder / "code",)
    order = make_order(study, next(study.trials()), folders, repeated=False)
    permit_of([])
    record = trial_program.run_trial_order(order, tmp_path / "out")
    assert record.failure is None and record.result is not None
    assert record.result.declaration == study.task
    assert msgspec.json.decode(msgspec.json.encode(study), type=Study).task == study.task


def test_a_study_has_one_task(folder: Path) -> None:
    path = folder / "study.toml"
    path.write_text(
        path.read_text() + '[[vary]]\nkey = "task.use"\nvalues = ["mine_of_studies:Mine", "cleaning"]\n'
    )
    permit = permit_of([folder / "code"])
    with pytest.raises(
        AcrcError, match="a variant has the task cleaning, another one mine; different tasks c"
    ):
        check_study(load_study(path), permit, path)
    path.write_text(path.read_text().partition("[[vary]]")[0].replace("places = 3", "settled = 3"))
    with pytest.raises(AcrcError, match=r"margins\.settled: must be one of places, lexicographic, contacts"):
        load_study(path)


def test_the_order_of_ranks_is_described() -> None:
    metrics = task_metrics(DELIVERY)
    assert metrics["lexicographic"].description == "delivered orders, then late orders"
