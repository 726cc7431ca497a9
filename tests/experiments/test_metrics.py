"""Metrics of a study's own: declaration, computation and its errors, comparison, plan and bundle."""

import json
import time
import zipfile
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import msgspec
import pyarrow
import pytest

from acrc_testbed.command_line import campaign_commands
from acrc_testbed.experiments import frozen_plan, metrics, store, trial_program, trial_settings
from acrc_testbed.experiments.comparison import comparison_of
from acrc_testbed.experiments.evaluation import evaluate, failure_sentences, verdict_sentence
from acrc_testbed.experiments.metrics import MetricError, MetricTable, by_rank, compute
from acrc_testbed.experiments.report import campaign_bundle
from acrc_testbed.experiments.report.report_page import write
from acrc_testbed.experiments.study import Study, Trial, load_study
from acrc_testbed.experiments.trial_pool import WorkerTask, _with_local_paths
from acrc_testbed.experiments.trial_record import CodeFolders, TrialRecord, make_order, write_json
from acrc_testbed.export.parquet_files import TABLES
from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.code_permit import Permit
from actors.runtime.errors import AcrcError
from actors.user_code import FINDER
from tests.experiments.made_runs import METRICS, run, sample, study, trials, verdict_of

IDLE = MetricTable("idle", "idle_functions:share", "less", "share of time in which robots stand", margin=0.02)
DOCKED = MetricTable("docked", "idle_functions:share", "more", unit="s", event="docked")
TABLES_OF_A_RUN = {name: pyarrow.table({"x": [1.0, 2.0]}) for name in (*metrics.LEAN_TABLES, "places")}
MODULE = "def share(tables):\n    return len(tables['poses'])\n"
STUDY = """
scenario = "corridor.toml"
strategies = ["none", "chapter"]
seeds = 6
primary_metric = "idle"

[set]
"robots.count" = 1

[[metric]]
name = "idle"
use = "{module}:share"
better = "less"
"""
_NUMBERS = count()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a study whose metric is a module of a new name beside it."""
    module = f"idle_functions_{next(_NUMBERS)}"
    (tmp_path / f"{module}.py").write_text(MODULE)
    (tmp_path / "study.toml").write_text(STUDY.replace("{module}", module))
    for name in ("corridor.yaml", "corridor.png"):
        (tmp_path / name).write_bytes((REPOSITORY / "maps" / name).read_bytes())
    scenario = (REPOSITORY / "scenarios" / "corridor.toml").read_text()
    (tmp_path / "corridor.toml").write_text(scenario.replace("../maps/", ""))
    monkeypatch.setattr(FINDER, "folders", ())
    for known in (campaign_commands, store):
        monkeypatch.setattr(known, "software_version", lambda: "c0ffee")
    return tmp_path


def valued(values: Sequence[float | None], name: str = "idle") -> list[RunResult]:
    return [run(0, metrics={name: value}) for value in values]


def computed(source: str, monkeypatch: pytest.MonkeyPatch, table: MetricTable = IDLE) -> float | None:
    """Return the metric of a function with this body."""
    names: dict[str, object] = {}
    exec(f"def share(tables):\n    import math, numpy, pyarrow, time\n    {source}\n", names)
    monkeypatch.setattr(metrics, "load_function", lambda use: names["share"])
    return compute(table, TABLES_OF_A_RUN)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("return sum(tables['poses']['x'].to_pylist())", 3.0),
        ("return numpy.float32(0.5)", 0.5),
        ("return numpy.int64(4)", 4.0),
        ("return pyarrow.scalar(2)", 2.0),
        ("return True", 1.0),
        ("return None", None),
        ("return sorted(tables)[0] == 'outcomes' and len(tables)", 4.0),
    ],
)
def test_a_function_returns_a_number_or_none(
    source: str, value: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert computed(source, monkeypatch) == value


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("return 'much'", "returned a str; must be a number or None"),
        ("return [1.0]", "returned a list; must be a number or None"),
        ("return numpy.array([1.0, 2.0])", "returned a ndarray; must be a number or None"),
        ("return math.nan", "returned nan; must be a finite number, or None"),
        ("return -math.inf", "returned -inf; must be a finite number, or None"),
        ("return 10 ** 400", "OverflowError"),
        ("return tables['knowledge']", "KeyError: 'knowledge'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
    ],
)
def test_what_is_no_number_is_a_fault(source: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = trial_program.attempt(lambda: computed(source, monkeypatch))
    assert found is not None and fault in found and "\n" not in found


def test_a_time_is_not_negative(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MetricError, match="returned -1; must be a time of at least 0 s, or None"):
        computed("return -1.0", monkeypatch, DOCKED)
    assert computed("return -1.0", monkeypatch) == -1.0


@pytest.mark.parametrize(
    "source",
    ["time.sleep(60)", "\n    while True:\n        try: time.sleep(60)\n        except Exception: 0"],
)
def test_a_slow_function_is_stopped(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "TIME_LIMIT_S", 0.2)
    began = time.monotonic()
    with pytest.raises(MetricError, match="idle_functions:share did not return within"):
        computed(source, monkeypatch)
    assert time.monotonic() - began < 10.0


def test_a_metric_that_ends_its_process_is_the_only_one_that_failed(
    plain: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Records are yielded before each function is called, so the last one stored tells which was running."""
    own = tuple(replace_name(IDLE, name) for name in ("first", "second", "third"))
    monkeypatch.setattr(trial_program, "read_tables", lambda out: TABLES_OF_A_RUN)
    monkeypatch.setattr(trial_program, "compute", lambda table, tables: float(len(table.name)))
    order = make_order(study(metric=own), Trial("one", 1), CodeFolders(), repeated=False)
    record = TrialRecord("one", 1, {}, plain)
    *before, last = trial_program.with_metrics(record, order, Path())
    assert last.result is not None and last.result.metrics == {"first": 5.0, "second": 6.0, "third": 5.0}
    assert last.result.metric_faults == {}
    assert [one.result.metrics for one in before if one.result] == [
        {}, {"first": 5.0}, {"first": 5.0, "second": 6.0},
    ]  # fmt: skip
    assert [[*one.result.metric_faults] for one in before if one.result] == [
        ["first", "second", "third"], ["second", "third"], ["third"],
    ]  # fmt: skip
    without = make_order(study(), Trial("one", 1), CodeFolders(), repeated=False)
    assert list(trial_program.with_metrics(record, without, Path())) == [record]
    assert b'"metric_faults' not in msgspec.json.encode(record)


def replace_name(table: MetricTable, name: str) -> MetricTable:
    return msgspec.structs.replace(table, name=name)


def test_own_metrics_are_compared_as_the_shipped_ones() -> None:
    made = study(primary_metric="idle", metric=(IDLE,))
    ones, others = [0.1 + 0.001 * seed for seed in range(20)], [0.3 + 0.002 * seed for seed in range(20)]
    found = verdict_of(valued(ones), valued(others), made)
    assert found.label == "better"
    assert verdict_sentence(found).startswith(
        "one is better than other in share of time in which robots stand: "
    )
    same = verdict_of(valued(ones), valued([value + 0.001 for value in ones]), made)
    assert same.steps[0].margin == 0.02 and same.steps[0].equivalent
    more = study(primary_metric="idle", metric=(msgspec.structs.replace(IDLE, better="more"),))
    assert verdict_of(valued(ones), valued(others), more).label == "worse"


def test_unknown_values_leave_out_their_pair_and_failed_runs_count_as_declared() -> None:
    ones = [*valued([1.0, None, 3.0]), run(0, metrics={}), None]
    pair = sample(ones, valued([0.0] * 5))
    assert comparison_of(pair, IDLE.metric()).scores.ones.tolist() == [1.0, 3.0]
    worst = msgspec.structs.replace(IDLE, worst=9.0)
    assert comparison_of(pair, worst.metric()).scores.ones.tolist() == [1.0, 3.0, 9.0]


def test_a_time_of_an_event_is_censored_at_the_end_of_the_run() -> None:
    none_failed = [*valued([5.0, None], "docked"), run(0, metrics={})]
    ones = [*none_failed, None]
    pair = sample(ones, valued([1.0] * 4, "docked"))
    later = comparison_of(pair, DOCKED.metric())
    assert later.scores.ones.tolist() == [5.0, 600.0, 0.0] and later.scores.sign == 1
    earlier = msgspec.structs.replace(DOCKED, better="less").metric()
    assert comparison_of(pair, earlier).scores.ones.tolist() == [5.0, 600.0, 600.0]
    never = valued([None] * 8, "docked")
    made = study(primary_metric="docked", metric=(DOCKED,))
    assert verdict_sentence(verdict_of(never, never, made)) == (
        "one and other cannot be compared in docked: no run was docked by 600 s."
    )


def test_the_order_of_decision_is_declared_by_ranks() -> None:
    assert [one.name for one in by_rank(reversed(METRICS.values()))] == ["places", "settled"]


def test_failed_metrics_are_told_with_study_metric_and_trial(plain: RunResult) -> None:
    made = study(metric=(msgspec.structs.replace(IDLE, worst=1.0),))
    fault = "idle_functions:share returned a str; must be a number or None"
    broken = msgspec.structs.replace(plain, metrics={}, metric_faults={"idle": fault})
    records = [*trials(plain, "one", lambda seed: (1, None), 2), TrialRecord("two", 7, {"n": 4}, broken)]
    assert failure_sentences(records, made) == [
        f"study made: metric idle failed in 1 run, first two with seed 7, n = 4: {fault}; it is unknown for "
        "these runs, and their pairs are left out of its comparison"
    ]
    failed = [TrialRecord("one", 1, {}, failure="it rained")]
    assert (
        "counts as a run with places = 0, never done or given up, idle = 1"
        in failure_sentences(failed, made)[0]
    )


@pytest.mark.parametrize(
    ("edit", "fault"),
    [
        (('name = "idle"', 'name = "places"'), "metric[0].name: 'places' is the name of another metric"),
        (('name = "idle"', 'name = "Idle time"'), 'metric[0].name is "Idle time", but must be a name of a-z'),
        (('better = "less"', ""), "metric[0].better is missing"),
        (('better = "less"', 'better = "low"'), 'metric[0].better is "low", but must be "more" or "less"'),
        ((":share", ".share"), "but must be a function, such as"),
        (
            ('"less"', '"less"\ntables = ["pose"]'),
            "metric[0].tables: 'pose' must be one of poses, people, outcomes, places, estimates, goals",
        ),
        (('"less"', '"less"\nmargin = 0'), "metric[0].margin is 0"),
        (('"less"', '"less"\nworst = inf'), "metric[0].worst is Infinity"),
        (("{end}", '[[metric]]\nname = "idle"\nuse = "a:b"\nbetter = "more"\n'), "metric[1].name: 'idle' is"),
    ],
)
def test_errors_of_a_declaration_name_the_key(edit: tuple[str, str], fault: str, folder: Path) -> None:
    path = folder / "study.toml"
    path.write_text((path.read_text() + "{end}").replace(*edit).replace("{end}", ""))
    with pytest.raises(AcrcError) as raised:
        load_study(path)
    assert fault in str(raised.value) and str(path) in str(raised.value)


def test_a_function_is_loaded_from_permitted_folders_only(folder: Path) -> None:
    path = folder / "study.toml"
    made = load_study(path)
    (use,) = (one.use for one in made.metric)
    module = use.partition(":")[0]
    with pytest.raises(AcrcError) as raised:
        trial_settings.check_study(made, Permit(), path)
    assert str(raised.value) == (
        f"{path}: metric {use}: its code {folder / module}.py is neither installed nor in a permitted "
        f"folder; read it, then add --modules {folder}, or --trust"
    )
    for permit in (Permit((folder,)), Permit(trust=True)):
        assert trial_settings.check_study(made, permit, path)[1] == CodeFolders((), (folder,), permit.modules)
    (one,) = made.metric
    wrong = msgspec.structs.replace(made, metric=(msgspec.structs.replace(one, use=f"{module}:shar"),))
    with pytest.raises(AcrcError, match=f"study.toml: metric idle: {module}:shar cannot be loaded: Attrib"):
        trial_settings.check_study(wrong, Permit(trust=True), path)


def test_a_worker_loads_functions_from_its_own_clone() -> None:
    made = study(scenario="/theirs/s.toml", metric=(IDLE,))
    order = make_order(made, Trial("one", 1), CodeFolders((), (Path("/theirs/mine"),)), repeated=False)
    here = _with_local_paths(WorkerTask(msgspec.json.encode(order), "", "/theirs", 1.0))
    assert here.metric_modules == (str(REPOSITORY / "mine"),) and here.study.metric == (IDLE,)
    assert not make_order(study(), Trial("one", 1), CodeFolders(), repeated=False).study.metric


def ended(folder: Path, plain: RunResult) -> store.Store:
    """Return a campaign of the study in which `chapter` stands less, and a plan if frozen."""
    source = folder / "study.toml"
    kept = store.create_store(folder / "out", load_study(source))
    store.record_plan(kept, store.find_plan(None, source), source, looks=False)
    for trial in kept.study.trials():
        value = 0.1 * trial.seed + (trial.strategy == "none")
        result = msgspec.structs.replace(
            plain, seed=trial.seed, metrics={"idle": value}, metric_faults={},
            origin=msgspec.structs.replace(plain.origin, commit="c0ffee"),
        )  # fmt: skip
        write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))
    return kept


def test_a_frozen_plan_holds_the_declaration_and_the_source(folder: Path, plain: RunResult) -> None:
    campaign_commands.freeze(folder / "study.toml", None, until_decided=False, json=False)
    (module,) = folder.glob("idle_*.py")
    plan = frozen_plan.read_plan(folder / "study.frozen.json")
    assert module.name in dict(plan.files) and plan.study.metric[0].name == "idle"
    assert str(folder) not in (folder / "study.frozen.json").read_text()
    assert "The campaign follows the plan." in evaluate(ended(folder, plain)).declared
    module.write_text(MODULE.replace("len(", "2 * len("))
    study_file = folder / "study.toml"
    study_file.write_text(study_file.read_text().replace('"less"', '"more"'))
    (folder / "out").rename(folder / "before")
    found = evaluate(ended(folder, plain)).declared
    assert f"Deviation from the plan: the content of {module.name} was changed." in found
    assert any(line.startswith("Deviation from the plan: metric is [") for line in found)


def test_the_source_of_an_installed_function_is_frozen_too(folder: Path) -> None:
    path = folder / "study.toml"
    (module,) = folder.glob("idle_*.py")
    path.write_text(path.read_text().replace(f"{module.stem}:share", "rich.table:Table"))
    campaign_commands.freeze(path, None, until_decided=False, json=False)
    assert "table.py" in dict(frozen_plan.read_plan(folder / "study.frozen.json").files)


def test_report_tables_and_bundle_have_the_metric(folder: Path, plain: RunResult, tmp_path: Path) -> None:
    kept = ended(folder, plain)
    found = evaluate(kept)
    assert found.verdicts[0].label == "better" and found.verdicts[0].steps[0].metric == "idle"
    assert [one.metric for one in found.estimates][-1] == "idle"
    page = write([kept.folder], tmp_path / "report").read_text()
    assert "own metrics: idle" in page and "idle (less is better)" in page
    means = (tmp_path / "report" / "cost.csv").read_text().splitlines()
    assert means[0].split(",")[1] == "idle (less is better)"
    assert [float(line.split(",")[1]) for line in means[1:]] == pytest.approx([1.35, 0.35])
    campaign_bundle.make_bundle(kept.folder, tmp_path / "made.zip")
    with zipfile.ZipFile(tmp_path / "made.zip") as archive:
        archive.extractall(tmp_path / "unpacked")
    (top,) = (tmp_path / "unpacked").iterdir()
    bundled = load_study(top / "study.json")
    (one,) = bundled.metric
    module = one.use.partition(":")[0]
    assert (Path(bundled.modules) / f"{module}.py").read_text() == MODULE
    assert json.loads((top / "results" / "study.json").read_text())["modules"].startswith("../inputs")


def test_names_of_tables_are_those_of_the_export() -> None:
    assert {*metrics.LEAN_TABLES, *metrics.FULL_TABLES} == {table.name for table in TABLES} - {"places"}


def test_studies_without_own_metrics_load_no_code(folder: Path) -> None:
    plain_study = msgspec.structs.replace(load_study(folder / "study.toml"), metric=(), modules="")
    assert isinstance(plain_study, Study) and not metrics.needs_full_recording(plain_study.metric)
    assert trial_settings.check_study(plain_study, Permit(), None)[1] == CodeFolders()
    assert metrics.needs_full_recording([msgspec.structs.replace(IDLE, tables=("goals",))])
