"""The report of a made-up campaign: its numbers, its pictures, its page."""

import base64
import csv
import html
import re
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from statsmodels.stats.proportion import proportion_confint

from acrc_testbed.experiments import store
from acrc_testbed.experiments.evaluation import evaluate
from acrc_testbed.experiments.report import charts, findings, report_page
from acrc_testbed.experiments.report.report_view import REAL, read_sources
from acrc_testbed.experiments.study import Factor, Study, Trial
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.results.result import RobotResult, RunResult, field_trial_struct
from actors.runtime.errors import AcrcError
from tests.experiments import made_runs
from tests.experiments.made_runs import CLEANING
from tests.experiments.report.made_up import LENGTH, campaign

EVIL = "<img src=http://evil.example/x onerror=alert(1)> $\\frac{1}{"
STUDY = Study(
    name="five & <b>six</b>", task=CLEANING, scenario="/nowhere/chapter.toml",
    strategies=("none", "oracle", "a$b_{<i>"), seeds=7, primary=(("none", "oracle"),),
)  # fmt: skip


def drawn(trial: Trial, rng: np.random.Generator) -> tuple[int, float | None]:
    done = min(40, round(float(rng.normal({"none": 30, "oracle": 43}.get(trial.strategy, 38), 2))))
    return done, float(rng.uniform(200, LENGTH)) if done == 40 else None


@pytest.fixture(scope="module")
def folder(plain: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    def fails(trial: Trial) -> str | None:
        return EVIL if (trial.strategy, trial.seed) == ("none", 2) else None

    where = tmp_path_factory.mktemp("campaigns") / "five"
    return campaign(where, plain, STUDY, drawn, fails=fails, with_time=True)


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report")
    assert report_page.write([folder], out) == out / "report.html"
    return out


@pytest.fixture(scope="module")
def records(folder: Path) -> dict[str, list[TrialRecord]]:
    found: dict[str, list[TrialRecord]] = {}
    for record in store.load_store(folder).records():
        if record.result is not None:
            name = "oracle (upper bound)" if record.strategy == "oracle" else record.strategy
            found.setdefault(name, []).append(record)
    return found


def rows(written: Path, name: str) -> list[dict[str, str]]:
    with (written / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def results(records: list[TrialRecord]) -> list[RunResult]:
    return [record.result for record in records if record.result is not None]


def test_boxes_are_those_of_the_runs(written: Path, records: dict[str, list[TrialRecord]]) -> None:
    table = rows(written, "places")
    assert [row["strategy"] for row in table] == list(records)
    for row in table:
        places = sorted(float(run.task["places_done"] or 0) for run in results(records[row["strategy"]]))
        assert int(row["runs"]) == len(places)
        assert (float(row["minimum"]), float(row["maximum"])) == (places[0], places[-1])
        assert float(row["median"]) == pytest.approx(np.quantile(places, 0.5))
        assert float(row["1st quartile"]) == pytest.approx(np.quantile(places, 0.25))
        assert float(row["3rd quartile"]) == pytest.approx(np.quantile(places, 0.75))
        assert float(row["mean"]) == pytest.approx(sum(places) / len(places))


def test_whiskers_end_outside_the_box() -> None:
    """The lower quartile, 25.25, lies between an outlier and the least value within 1.5 box lengths."""
    values = (11.0, 11.0, 30.0, 30.0, 31.0, 32.0, 32.0, 33.0)
    box = charts.Box("none", charts.series_style(0), values)
    (panel,) = charts.draw_boxes({"": [box]}, "places").axes
    lines = [np.unique(np.asarray(line.get_xdata(), float)).tolist() for line in panel.lines]
    assert [25.25] in lines and [25.25, 30.0] not in lines


def test_completion_counts_every_run(written: Path, records: dict[str, list[TrialRecord]]) -> None:
    for row in rows(written, "completion"):
        runs = results(records[row["strategy"]])
        done = sum(run.task["completion_s"] is not None for run in runs)
        assert (int(row["runs"]), int(row["done"])) == (len(runs), done)
        n = len(runs)
        bounds = proportion_confint(done, n, method="wilson")
        found = float(row["share done, low"]), float(row["share done, high"])
        assert found == pytest.approx(bounds, abs=1e-9)
        # without censoring before the end the area is the mean of what is capped
        ends: list[Any] = [run.task["completion_s"] for run in runs]
        mean = sum(LENGTH if end is None else end for end in ends) / n
        assert float(row["restricted mean, s"]) == pytest.approx(mean)
        assert float(row["restricted mean, s, low"]) <= mean <= float(row["restricted mean, s, high"])


def test_shares_of_time(written: Path, records: dict[str, list[TrialRecord]]) -> None:
    for row in rows(written, "time"):
        robots = [part for one in records[row["strategy"]] if one.time for part in one.time.robots.values()]
        assert float(row["deadlock"]) == pytest.approx(
            100 * sum(part["deadlock"] for part in robots) / (LENGTH * len(robots))
        )
        assert sum(float(row[name]) for name in robots[0]) == pytest.approx(100.0)


def test_decisions_are_counted_by_trigger(written: Path, records: dict[str, list[TrialRecord]]) -> None:
    table = rows(written, "decisions")
    for name, kept in records.items():
        mine = {row["outcome"]: row for row in table if row["strategy"] == name}
        assert {outcome: int(row["decisions"]) for outcome, row in mine.items()} == {
            "blocked again": len(kept), "free": 2 * len(kept),
        }  # fmt: skip
        waited = sorted(
            event.blocked_s + event.free_after_s
            for record in kept
            for event in (record.time.decisions if record.time else ())
            if event.free_after_s is not None
        )
        assert float(mine["free"]["from blocked to driving on, s"]) == pytest.approx(np.quantile(waited, 0.5))
    assert len(rows(written, "decision_events")) == 3 * sum(map(len, records.values()))


def test_costs_are_means_over_runs(written: Path, records: dict[str, list[TrialRecord]]) -> None:
    for row in rows(written, "cost"):
        runs = results(records[row["strategy"]])
        n = len(runs)
        assert float(row["adoptions in a run"]) == float(row["decisions of the adaptation in a run"]) == 3
        own = sum(run.seed + 2 for run in runs) / 2 / n
        assert float(row["outcome.turns"]) == pytest.approx(own)
        air = sum((run.frames["bytes_sent"] + 6 * run.frames["frames_sent"]) * 32e-6 for run in runs)
        assert float(row["air time of a robot, % of the time"]) == pytest.approx(100 * air / (n * 4 * LENGTH))
        cpu = 1000 * sum(run.cpu_s for run in runs) / (n * 4 * LENGTH)
        assert float(row["CPU, ms per robot and simulated s"]) == pytest.approx(cpu)


def test_every_run_stands_in_the_table_of_runs_failures_too(written: Path) -> None:
    table = rows(written, "runs")
    assert len(table) == 21
    (failed,) = [row for row in table if not row["digest"]]
    assert failed["failure"] == EVIL
    (cause,) = rows(written, "failures")
    assert (cause["cause"], cause["runs"], cause["seeds"]) == (EVIL, "1", "2")


def test_every_picture_has_numbers_words_and_files(folder: Path, tmp_path: Path) -> None:
    page = report_page.compose(read_sources([folder]), tmp_path)
    pictured = [one for one in page.sections if one.picture is not None]
    assert len(pictured) == 8
    for one in pictured:
        assert one.picture is not None and one.tables and one.tables[0].rows
        assert len(one.picture.alt) > 60
    for suffix, begin in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        files = list(tmp_path.glob(f"*.{suffix}"))
        assert len(files) == 8 and all(one.read_bytes().startswith(begin) for one in files)


class Reader(HTMLParser):
    """Everything on a page that could reach out, and whether its tags are closed."""

    EMPTY = ("meta", "img", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_needs_nothing_and_runs_nothing(written: Path) -> None:
    page = (written / "report.html").read_text()
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    assert not {"script", "link", "iframe", "object", "base", "form"} & set(reader.tags)
    for tag, name, value in reader.attributes:
        assert not name.startswith("on"), tag
        if name == "href":
            assert value.startswith("#")
        if name == "src":
            assert value.startswith("data:image/svg+xml;base64,")
            drawing = base64.b64decode(value.partition(",")[2]).decode()
            assert "<script" not in drawing and "<image" not in drawing
            links = re.findall(r'(?:xlink:)?href="([^"]*)"', drawing)
            assert all(link.startswith("#") for link in links)
    assert "@import" not in page and "url(" not in page
    assert "<script" not in page


def test_names_and_failures_are_escaped(written: Path) -> None:
    page = (written / "report.html").read_text()
    assert EVIL not in page and html.escape(EVIL) in page
    assert "<b>six</b>" not in page and "<i>" not in page
    assert "a$b_{&lt;i&gt;" in page


def test_the_sentences_are_those_of_the_comparison(folder: Path, written: Path) -> None:
    page = html.unescape((written / "report.html").read_text())
    said = evaluate(store.load_store(folder)).sentences()
    assert said[0].startswith("none failed in 1 of 7 runs (seed 2); each counts as")
    assert said[-1].startswith("none is worse than oracle in places done: ")  # the way it was declared
    assert said[1] == "No plan was frozen before the first run."
    assert len(said) == 4
    for one in said:
        assert one.replace("oracle", "oracle (upper bound)") in page


def test_caveats_are_on_the_page(written: Path) -> None:
    page = html.unescape((written / "report.html").read_text())
    for told in (
        "five: 1 of 21 runs failed and are not in the pictures",
        "oracle uses information that robots do not have; it is an upper bound",
        "of the runs have the largest possible value of places done: ",
        "Mean number of deadlocked pairs per run: none ",
        "Without a run that was done: none. Their restricted mean",
    ):
        assert told in page


def test_caveats_about_runs_and_seeds(plain: RunResult, tmp_path: Path) -> None:
    lie = "r1: what it says of its node cannot be, and is not counted: 9 packets heard; the radio counted 1"
    lied = msgspec.structs.replace(plain, refused_reports=(lie,))
    study = Study(
        name="few", task=CLEANING, scenario="/s.toml", strategies=("none", "chapter"), seeds=2, tuning=True
    )
    campaign(tmp_path / "few", lied, study, drawn)
    trial = next(iter(study.trials()))

    def cautions() -> Sequence[str]:
        return report_page.compose(read_sources([tmp_path / "few"]), tmp_path).sections[1].warnings

    told = " ".join(cautions())
    store.load_store(tmp_path / "few").path(trial).unlink()
    less = cautions()
    assert "tuning seeds" in told
    assert "chapter and none: 2 pairs of runs are too few: the exact test needs at least 6" in told
    assert f"few: none, seed {trial.seed}: {lie}." in told
    assert "few: 1 of 4 runs are missing; results may change." in less


def test_a_campaign_that_only_failed_has_a_page_without_pictures(plain: RunResult, tmp_path: Path) -> None:
    campaign(
        tmp_path / "all",
        plain,
        Study(name="all", task=CLEANING, scenario="/s.toml", strategies=("none",), seeds=3),
        drawn,
        fails=lambda trial: "it rained",
    )
    page = report_page.write([tmp_path / "all"], tmp_path / "out").read_text()
    assert "it rained" in page and "<img" not in page
    assert not list((tmp_path / "out").glob("*.png"))


def field_trial(plain: RunResult) -> RunResult:
    frames = {"frames_handed": 9, "frames_sent": 8, "copies_heard": 20, "bytes_sent": 400}
    robot = field_trial_struct(
        RobotResult,
        task={"places_total": 10, "places_done": None, "places_claimed": 7, "completion_s": None},
        reports=7, gave_up=0, frames=frames, lateness_p50_ms=None, lateness_p99_ms=None, overruns=None,
        clock=(), recordings=(),
    )  # fmt: skip
    return field_trial_struct(
        RunResult,
        robots=1, duration_s=300.0, declaration=plain.declaration, task_summary="reported 7 of 10 places",
        task=robot.task | {"settled_s": None}, per_robot={"r1": robot},
        contacts=None, frames=frames, radio_bytes_per_robot_s=1.333, deeco=plain.deeco, reference="r1",
        notes=("r2: no frame connects its clock",), out=None,
    )  # fmt: skip


def thirty(trial: Trial, rng: np.random.Generator) -> tuple[int, float | None]:
    return 30, None


def put(folder: Path, name: str, result: RunResult) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True)
    path.write_bytes(msgspec.json.encode(result))
    return folder


def test_a_report_on_real_robots_and_a_run(plain: RunResult, tmp_path: Path) -> None:
    real = put(tmp_path / "friday", "run.json", field_trial(plain))
    run = put(tmp_path / "simulated", "result/run.json", plain)
    sources = read_sources([real, run])
    assert [one.conditions[0] for one in sources] == [REAL, "one scenario, 1 robots, 1 s"]
    assert [one.records[0].strategy for one in sources] == ["friday", "chapter"]
    page = report_page.write([real, run], tmp_path / "out").read_text()
    assert "Real robots have no ground truth: places are as reported" in page
    assert "friday: r2: no frame connects its clock." in page
    assert "2 of the folders contain a single run each" in page
    assert "Values of real robots are as reported" in page
    assert "Nothing was compared." in page


def test_variants_are_conditions_and_so_are_campaigns(plain: RunResult, tmp_path: Path) -> None:
    study = Study(
        name="chapter",
        task=CLEANING,
        scenario="/s.toml",
        strategies=("none",),
        seeds=1,
        factors=(Factor("robots.count", (4, 8)),),
    )
    one = campaign(tmp_path / "one", plain, study, thirty)
    other = campaign(
        tmp_path / "x" / "one",
        plain,
        Study(name="chapter", task=CLEANING, scenario="/s.toml", strategies=("none",), seeds=1),
        thirty,
    )
    assert read_sources([one])[0].conditions == ("robots.count = 4", "robots.count = 8")
    assert [source.conditions for source in read_sources([one, other])] == [
        ("one: robots.count = 4", "one: robots.count = 8"),
        ("one-2",),
    ]


def test_a_folder_that_holds_nothing_is_named(tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match="contains no campaign and no result of a run"):
        read_sources([tmp_path])
    (tmp_path / "run.json").write_text('{"digest": 3}')
    with pytest.raises(AcrcError, match=r"run\.json: invalid result of a run: digest is 3, but must be"):
        read_sources([tmp_path])


def test_an_event_in_no_run_has_no_p_value() -> None:
    """All runs are censored, so the times of both strategies are equal but unknown."""
    level = [made_runs.run(20) for _ in range(8)]
    places, time = map(findings._test_cells, made_runs.verdict_of(level, level).steps)
    assert places["p (equivalence)"] == 2.0**-8
    assert time["margin"] == 10.0 and time["p"] is None and time["p (equivalence)"] is None
