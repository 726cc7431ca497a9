"""Logs of courses, errors of a localisation on them, and the comparison with another localisation."""

import json
import math
import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import stats

from acrc_testbed.benchmarks import localisation_comparison as comparison
from acrc_testbed.benchmarks import localisation_tracking as tracking
from acrc_testbed.benchmarks.localisation_comparison import (
    ReferenceRun,
    ReferenceRuns,
    bootstrap_means,
    root_mean_square,
    table_row,
)
from acrc_testbed.benchmarks.localisation_tracking import (
    NEES_BOUNDS,
    CourseLogError,
    EstimatedTrack,
    FilterRun,
    errors_against_truth,
    nees,
    weighed_calls,
)
from actors.geometry import Pose
from actors.installation.repository import REPOSITORY
from tests.localisation.courses import Setup, drive, write_log

SETUP = Setup(seed=5, robots=4, view="kinect", base="kobuki", seconds=6)
Change = Callable[[bytes], bytes | None]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "course.zip"
    write_log(file, drive(SETUP))
    return file


def changed(file: Path, to: Path, **changes: Change) -> Path:
    """Copy a log with changed members, named without their suffix; None leaves a member out."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(to, "w") as target:
        for name in source.namelist():
            content: bytes | None = source.read(name)
            if content is not None and (change := changes.get(name.partition(".")[0])) is not None:
                content = change(content)
            if content is not None:
                target.writestr(name, content)
    return to


def test_a_log_is_read_exactly(written: Path, tmp_path: Path) -> None:
    course, back = drive(SETUP), tracking.read_course(written)
    assert (course.sensor, course.start) == (back.sensor, back.start)
    np.testing.assert_array_equal(course.grid.cells, back.grid.cells)
    for name in ("instants", "odometry", "truth", "stamps", "scans"):
        np.testing.assert_array_equal(getattr(course, name), getattr(back, name))
    write_log(tmp_path / "again.zip", back)
    assert (tmp_path / "again.zip").read_bytes() == written.read_bytes()


def test_the_reader_of_the_page_reads_a_log(written: Path) -> None:
    page = (REPOSITORY / "docs" / "localisation-log.md").read_text("utf-8")
    (source,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {}
    exec(source, names)
    sensor, start, odometry, truth, scans = names["load"](written)
    course = drive(SETUP)
    assert sensor == msgspec.to_builtins(course.sensor) and tuple(start) == course.start
    assert all(f"sensor.{field}`" in page for field in sensor)
    np.testing.assert_array_equal(odometry, np.column_stack([course.instants, course.odometry]))
    np.testing.assert_array_equal(truth, np.column_stack([course.instants, course.truth]))
    metres = np.array([ranges for _, ranges in scans], np.float64)  # None becomes NaN
    np.testing.assert_array_equal(np.isnan(metres), course.scans == 65535)


def test_truth_is_interpolated_and_the_odometry_frame_may_be_any(written: Path, tmp_path: Path) -> None:
    course = drive(SETUP)
    lines = {"truth": lambda content: b"\n".join([content.split(b"\n")[0], *content.split(b"\n")[1::2], b""])}
    sparse = tracking.read_course(changed(written, tmp_path / "sparse.zip", **lines))
    np.testing.assert_allclose(sparse.truth, course.truth, atol=0.02)
    frame = Pose(-700.0, 3000.0, 2.5)
    moved = np.array([frame.compose(Pose(*pose)) for pose in course.odometry.tolist()])
    write_log(tmp_path / "moved.zip", replace(course, odometry=moved))
    there, here = (comparison.check(file).figures for file in (tmp_path / "moved.zip", written))
    assert set(there) == {"chapter", "robust", "odometry"}
    for preset, runs in there.items():
        assert runs[0]["rmse"] == pytest.approx(here[preset][0]["rmse"], rel=0.5, abs=1e-6)


def of_json(**fields: Any) -> Change:
    return lambda content: json.dumps(json.loads(content) | fields).encode()


FAULTS: list[tuple[str, Change, str]] = [
    ("about", lambda _: None, "about.json is missing"),
    ("about", lambda _: b"[" * 60_000, "about.json is not JSON"),
    ("about", lambda _: b" " * 70_000, "about.json has more than the 65536 bytes allowed"),
    ("about", of_json(version=2), 'must have "format": "acrc-localisation-log" and "version": 1'),
    ("about", of_json(start=[1, 2, math.nan]), "start in about.json is [1, 2, nan], but must be"),
    ("about", of_json(sensor=None), "in about.json, sensor is null, but must be a table"),
    ("map", lambda content: content[:20], "map."),
    ("odometry", lambda content: content.split(b"\n")[0], "odometry.csv has no rows"),
    ("odometry", lambda content: content + b"0,0,0,0\n", "is not later than in the row before"),
    ("odometry", lambda content: content + b"nan,0,0,0\n", "odometry.csv has a time_us that is not a whole"),
    ("odometry", lambda content: content + b"7e6,0,inf,0\n", "odometry.csv has a value beyond ± 1e+06"),
    ("odometry", lambda content: content + b"7e6,0,x\n", "odometry.csv is not a table of numbers"),
    ("truth", lambda content: b"\n".join(content.split(b"\n")[:9]), "but must cover odometry.csv"),
    ("scans", lambda content: content.replace(b",65535", b",7.5"), "is not a whole number from 0 to 65535"),
]


@pytest.mark.parametrize(("member", "change", "sentence"), FAULTS, ids=[said[:30] for *_, said in FAULTS])
def test_a_faulty_log_gives_one_sentence(
    written: Path, tmp_path: Path, member: str, change: Change, sentence: str
) -> None:
    bad = changed(written, tmp_path / "bad.zip", **{member: change})
    with pytest.raises(CourseLogError, match=re.escape(sentence)) as caught:
        tracking.read_course(bad)
    assert str(caught.value).startswith(f"{bad}: ") and "\n" not in str(caught.value)


def test_the_size_of_a_table_is_limited(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "TEXT_BYTES", 1000)
    with pytest.raises(CourseLogError, match=r"odometry\.csv has more than the 1000 bytes allowed"):
        tracking.read_course(written)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused(written: Path, tmp_path: Path, data: st.DataObject) -> None:
    whole = written.read_bytes()
    directory = whole.index(b"PK\x01\x02")  # no checksum covers the archive's own structures
    places = st.integers(0, len(whole) - 1) | st.integers(directory, len(whole) - 1)
    damaged = bytearray(whole)
    for place, value in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=4)):
        damaged[place] = value
    file = tmp_path / "damaged.zip"
    file.write_bytes(damaged[: data.draw(st.just(len(whole)) | places)])
    try:
        tracking.read_course(file)
    except CourseLogError as error:
        assert "\n" not in str(error)


def test_a_folder_of_logs_is_compared_with_another_localisation(written: Path, tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    for name in ("a", "b"):
        (tmp_path / "logs" / f"{name}.zip").hardlink_to(written)
    runs = [{"rmse": rmse, "lost": False, "nmed": 0.2, "updates": 12} for rmse in (0.04, 0.06)]
    theirs = tmp_path / "theirs.json"
    theirs.write_text(json.dumps([{"log": name, "runs": runs} for name in ("a", "b", "unused")]))
    found = comparison.check(tmp_path / "logs", 2, theirs)
    rows = {(row["preset"], row["log"]): row for row in found.figures["against"]}
    assert set(rows) == {(p, name) for p in ("chapter", "robust") for name in ("a", "b", "all 2")}
    row = rows["robust", "a"]
    ours = np.mean([run["rmse"] for run in found.figures["logs"]["a"]["robust"]])
    assert row["ratio"] == pytest.approx(ours / 0.05) and row["low"] <= row["ratio"] <= row["high"]
    assert row["lost"] == "0/2, 0/2" and row["nees"].endswith(", 0.20")
    assert found.holds == (rows["chapter", "all 2"]["ratio"] <= 1)
    theirs.write_text(json.dumps([{"log": "a", "runs": runs}]))
    with pytest.raises(CourseLogError, match="the log 'b' is missing"):
        comparison.check(tmp_path / "logs", 1, theirs)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.binary(max_size=40)
    | st.recursive(
        st.none() | st.booleans() | st.floats() | st.sampled_from(["log", "runs", "rmse", "lost"]),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["log", "runs", "rmse", "lost"]), inner)
        ),
    ).map(lambda value: json.dumps(value).encode())
)
def test_results_of_another_localisation_are_checked(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "theirs.json"
    file.write_bytes(content)
    try:
        for other in comparison.load_reference_runs(file).values():
            assert other.runs and all(run.rmse > 0 for run in other.runs)
    except CourseLogError as error:
        assert str(file) in str(error)


def run_with(errors: Sequence[float], announced: Sequence[int] = (), turn: float = 0.0) -> FilterRun:
    count = len(errors)
    return FilterRun(
        1,
        np.array(errors, np.float32),
        np.full(count, turn, np.float32),
        np.full(count, 2.0, np.float32),
        np.isin(np.arange(count), announced),
        np.array([1e-4, 3e-4], np.float32),
        {},
    )


def test_the_interval_of_a_ratio_is_that_of_its_runs() -> None:
    def row(ours: Sequence[float], theirs: Sequence[float]) -> comparison.PairedRow:
        other = ReferenceRuns("x", [ReferenceRun(rmse, lost=rmse > 1) for rmse in theirs])
        runs = [run_with([value] * 3) for value in ours]
        one, _ = comparison.paired_rows({"x": {"chapter": runs, "robust": runs}}, {"x": other})
        return one

    clear = row([0.02, 0.021, 0.019, 0.02], [0.04, 0.041, 0.039, 0.04])
    assert clear.ratio == pytest.approx(0.5, rel=1e-6) and clear.high < 0.53
    wide = row([0.02, 2.0], [0.04, 0.05, 1.5])
    assert wide.low < 0.1 and wide.high > 10 and (wide.lost, wide.nees) == ("1/2, 1/3", "2.00, -")


def test_nees_of_errors_drawn_from_the_covariance_is_chi_squared() -> None:
    np.testing.assert_allclose(NEES_BOUNDS, stats.chi2(3).ppf([0.025, 0.975]), atol=5e-5)
    root = np.array([[0.2, 0.0, 0.0], [0.1, 0.05, 0.0], [0.01, 0.02, 0.003]])
    off = np.random.default_rng(5).standard_normal((20_000, 3)) @ root.T
    values = nees(off, np.broadcast_to(root @ root.T, (20_000, 3, 3)))
    assert stats.kstest(values, stats.chi2(3).cdf).pvalue > 0.01
    assert values[7] == pytest.approx(off[7] @ np.linalg.inv(root @ root.T) @ off[7], rel=1e-6)
    singular = np.stack([np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, math.nan, 1.0])])
    assert nees(np.zeros((3, 3)), singular).tolist() == [math.inf] * 3


def test_errors_use_the_shorter_arc() -> None:
    truth = np.array([[0.0, 0.0, 3.1], [1.0, 0.0, 3.1]])
    poses = np.array([[0.3, 0.4, -3.1], [1.0, 1.2, 3.0]])
    lost, costs = np.array([0.2, 0.96]), np.array([1e-4, 2e-4])
    track = EstimatedTrack(poses, np.tile(np.eye(3), (2, 1, 1)), lost, costs, {"updates": 2})
    run = errors_against_truth(9, truth, truth.copy(), track)
    np.testing.assert_allclose(run.errors, [0.5, 1.2], atol=1e-6)
    np.testing.assert_allclose(run.turns, [math.tau - 6.2, 0.1], atol=1e-6)
    np.testing.assert_allclose(run.nees, [0.25 + (math.tau - 6.2) ** 2, 1.44 + 0.01], atol=1e-6)
    assert run.announced.tolist() == [False, True] and run.figures()["lost"]
    drawn = np.cumsum(np.random.default_rng(1).normal(0, 0.1, (50, 3)), axis=0)
    corrected = drawn + np.repeat([[1.0, 2.0, 0.0], [1.1, 2.0, 0.0]], [20, 30], axis=0)
    assert np.flatnonzero(weighed_calls(drawn, corrected)).tolist() == [0, 20]


def test_lost_intervals_last_3_s_and_false_alarms_are_5_s_from_any_error() -> None:
    errors = [0.1] * 20 + [1.2] * 30 + [0.1] * 20 + [1.2] * 29 + [0.1] + [2.0] * 40
    assert run_with(errors, announced=(19, 50, 60, 80, 139)).spells == [False, True]
    errors = [0.1] * 100 + [0.6] + [0.1] * 100
    assert run_with(errors, announced=(20, 21, 23, 55, 149, 160)).false_alarms == 3
    assert [run_with([3.0, 0.6, 0.4]).found(step) for step in (0, 1, 2, 99)] == [False, False, True, True]


def test_the_error_of_all_runs_has_a_confidence_interval() -> None:
    runs = [run_with([0.1, 0.1]), run_with([0.1, 0.7]), run_with([0.1, 1.1])]
    rmse, row = root_mean_square(runs), table_row(runs)
    assert rmse.value == pytest.approx(math.sqrt((4 * 0.01 + 0.49 + 1.21) / 6), rel=1e-6)
    assert rmse.low < rmse.value < rmse.high
    wilson = stats.binomtest(1, 3).proportion_ci(method="wilson")
    assert row["lost"] == f"1/3 [{wilson.low:.0%}, {wilson.high:.0%}]"
    assert (row["> 0.5 m"], row["max"], row["NEES"]) == ("33.3%", "1.10", "2.00")
    draws = np.random.default_rng(3)
    means = [bootstrap_means(draws.uniform(0.5, 1.5, 30)) for _ in range(200)]
    bounds = [np.percentile(one, (2.5, 97.5)).tolist() for one in means]
    assert 178 <= sum(low <= 1.0 <= high for low, high in bounds) <= 198
