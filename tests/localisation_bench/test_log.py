import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.localisation import log
from benchmarks.localisation.course import Course, CourseSetup
from benchmarks.localisation.filters import Arm, replay
from benchmarks.localisation.log import CourseLogError, LogLimits
from tests.localisation_bench.scenes import APARTMENT, CORRIDOR, course

SETUP = CourseSetup(CORRIDOR, 5, robots=4, view="kinect", base="kobuki", seconds=6)
DOCUMENT = Path(__file__).parents[2] / "docs" / "localisation-log.md"
Change = Callable[[bytes], bytes | None]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "course.zip"
    log.write(file, course(SETUP))
    return file


def same(one: Course, other: Course) -> None:
    assert (one.sensor, one.start) == (other.sensor, other.start)
    assert (one.grid.resolution, one.grid.origin) == (other.grid.resolution, other.grid.origin)
    np.testing.assert_array_equal(one.grid.cells, other.grid.cells)
    for name in ("instants", "odometry", "truth", "stamps", "scans"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def changed(file: Path, member: str, change: Change, to: Path) -> Path:
    """A copy with one member changed; None leaves it out."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(to, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            new = change(content) if name == member else content
            if new is not None:
                target.writestr(name, new)
    return to


@pytest.mark.parametrize("setup", [SETUP, CourseSetup(APARTMENT, 1, seconds=3)])
def test_what_is_written_is_read_to_the_last_bit(setup: CourseSetup, tmp_path: Path) -> None:
    first, again = tmp_path / "first.zip", tmp_path / "again.zip"
    log.write(first, course(setup))
    back = log.read(first)
    same(course(setup), back)
    log.write(again, back)
    assert first.read_bytes() == again.read_bytes()


@pytest.mark.parametrize("preset", ["chapter", "robust"])
def test_a_filter_fed_from_the_file_gives_what_it_gives_directly(written: Path, preset: str) -> None:
    arm, direct, back = Arm(preset), course(SETUP), log.read(written)  # type: ignore[arg-type]
    one, other = replay(direct, arm.localisation(direct, 1)), replay(back, arm.localisation(back, 1))
    assert one.outcome == other.outcome and one.outcome["updates"] != 0
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.covariances, other.covariances)


def test_the_reader_in_the_document_reads_it(written: Path) -> None:
    source = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text("utf-8"), re.DOTALL)
    assert len(source) == 1 and 10 <= sum(map(bool, source[0].split("\n"))) <= 15
    names: dict[str, Any] = {}
    exec(source[0], names)  # the very text that is documented
    sensor, start, odometry, truth, scans = names["load"](written)
    a = course(SETUP)
    assert sensor == a.sensor.model_dump() and tuple(start) == a.start
    np.testing.assert_array_equal(odometry, np.column_stack([a.instants, a.odometry]))
    np.testing.assert_array_equal(truth, np.column_stack([a.instants, a.truth]))
    assert [time for time, _ in scans] == a.stamps.tolist()
    metres = np.array([ranges for _, ranges in scans], np.float64)  # None becomes nan
    np.testing.assert_array_equal(np.isnan(metres), a.scans == 65535)
    np.testing.assert_allclose(metres[~np.isnan(metres)] * 1000, a.scans[a.scans != 65535])


def test_the_document_names_every_field_of_the_sensor() -> None:
    text = DOCUMENT.read_text("utf-8")
    for field in course(SETUP).sensor.model_dump():
        assert f"sensor.{field}`" in text


def test_truth_at_other_times_is_interpolated_and_the_odometry_s_frame_may_be_any(tmp_path: Path) -> None:
    a = course(SETUP)
    sparse = replace(a, instants=a.instants[::2], odometry=a.odometry[::2], truth=a.truth[::2])
    file, mixed = tmp_path / "sparse.zip", tmp_path / "mixed.zip"
    log.write(file, sparse)
    whole = tmp_path / "whole.zip"
    log.write(whole, a)
    with zipfile.ZipFile(whole) as archive:
        dense = archive.read("odometry.csv")
    back = log.read(changed(file, "odometry.csv", lambda _: dense, mixed))
    np.testing.assert_array_equal(back.instants, a.instants)
    np.testing.assert_allclose(back.truth, a.truth, atol=0.02)
    np.testing.assert_array_equal(back.truth[::2, :2], a.truth[::2, :2])
    begun_late = replace(a, odometry=a.odometry + np.array([3.0, -2.0, 0.0]))
    log.write(file, begun_late)
    moved = log.read(file)
    led = replay(moved, Arm("odometry").localisation(moved, 1)).poses
    plain = replay(a, Arm("odometry").localisation(a, 1)).poses
    np.testing.assert_allclose(led, plain, atol=1e-9)


def about(**fields: object) -> Change:
    return lambda content: json.dumps(json.loads(content) | fields).encode()


def sensor(**fields: object) -> Change:
    def change(content: bytes) -> bytes:
        told = json.loads(content)
        return json.dumps(told | {"sensor": told["sensor"] | fields}).encode()

    return change


def row(number: int, text: str) -> Change:
    def change(content: bytes) -> bytes:
        lines = content.decode().split("\n")
        lines[number] = text
        return "\n".join(lines).encode()

    return change


_RANGE = "scans.csv has a range that is no whole number from 0 to 65535 mm"
BAD: list[tuple[str, Change, str]] = [
    ("about.json", lambda _: None, "about.json is missing"),
    ("about.json", lambda _: b"{", "about.json is no JSON"),
    ("about.json", lambda _: b"[" * 60_000, "about.json is no JSON"),
    ("about.json", lambda _: b" " * 70_000, "about.json has more than the 65536 bytes allowed"),
    ("about.json", about(version=2), 'must have "format": "acrc-localisation-log" and "version": 1'),
    ("about.json", about(start=[1, 2]), "start in about.json is [1, 2], but must be"),
    ("about.json", about(start=[1, 2, float("nan")]), "start in about.json is [1, 2, nan], but must be"),
    ("about.json", about(sensor=None), "in about.json, sensor: "),
    ("about.json", sensor(rays=0), "in about.json, sensor.rays: "),
    ("about.json", sensor(rays=8), "but its first line must be time_us,r0,r1,r2,r3,r4,r5,r6,r7."),
    ("about.json", sensor(colour=1), "in about.json, sensor.colour: "),
    ("map.yaml", lambda _: b"image: map.png", "map.yaml: the key 'resolution' is missing"),
    ("map.yaml", lambda content: content.replace(b"map.png", b"/etc/passwd"), "passwd"),
    ("map.png", lambda content: content[:200], "map.png"),
    ("odometry.csv", lambda _: b"", "odometry.csv begins with '', but its first line must be time_us,x,y,"),
    ("odometry.csv", lambda content: content.split(b"\n")[0], "odometry.csv has no rows"),
    ("odometry.csv", row(2, "0,0,0,0"), "time_us in row 2 of odometry.csv is not later than"),
    ("odometry.csv", row(2, "1.5,0,0,0"), "odometry.csv has a time_us that is no whole number"),
    ("odometry.csv", row(2, "nan,0,0,0"), "odometry.csv has a time_us that is no whole number"),
    ("odometry.csv", row(2, "100000,0,inf,0"), "odometry.csv has a value beyond ± 1e+06 or"),
    ("odometry.csv", row(2, "100000,x,0,0"), "odometry.csv is no table of numbers"),
    ("odometry.csv", row(2, "100000,0,0"), "odometry.csv is no table of numbers"),
    ("truth.csv", lambda content: b"\n".join(content.split(b"\n")[:9]), "but must hold all of odometry.csv"),
    ("scans.csv", lambda content: content.replace(b",65535", b",65536"), _RANGE),
    ("scans.csv", lambda content: content.replace(b",65535", b",-1"), _RANGE),
    ("scans.csv", lambda content: content.replace(b",65535", b",7.5"), _RANGE),
]  # fmt: skip


@pytest.mark.parametrize(("member", "change", "said"), BAD, ids=[said[:40] for _, _, said in BAD])
def test_a_bad_log_gets_one_sentence(
    written: Path, tmp_path: Path, member: str, change: Change, said: str
) -> None:
    bad = changed(written, member, change, tmp_path / "bad.zip")
    with pytest.raises(CourseLogError) as caught:
        log.read(bad)
    told = str(caught.value)
    assert said in told and told.startswith(str(bad)) and told.endswith(".") and "\n" not in told


def test_no_archive_or_none_or_one_too_large_gets_one_sentence(written: Path, tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no archive")
    with pytest.raises(CourseLogError, match="this is not a localisation log, which is a ZIP archive"):
        log.read(tmp_path / "text.zip")
    with pytest.raises(CourseLogError, match="cannot be read"):
        log.read(tmp_path / "none.zip")
    with pytest.raises(CourseLogError, match="cannot be written"):
        log.write(tmp_path / "none" / "course.zip", course(SETUP))
    with pytest.raises(CourseLogError, match=r"odometry\.csv has more than the 1000 bytes allowed"):
        log.read(written, LogLimits(text_bytes=1000))


def test_damage_is_either_harmless_or_a_log_error(written: Path, tmp_path: Path) -> None:
    draws, whole, refused = np.random.default_rng(7), written.read_bytes(), 0
    directory = whole.rindex(b"PK\x01\x02", 0, whole.index(b"PK\x01\x02") + 4)
    for _ in range(150):
        damaged = bytearray(whole)
        # half of it in the archive's own structures, which no checksum covers
        first = directory if draws.random() < 0.5 else 0
        for place in draws.integers(first, len(whole), draws.integers(1, 4)).tolist():
            damaged[place] = int(draws.integers(256))
        file = tmp_path / "damaged.zip"
        file.write_bytes(damaged[: int(draws.integers(len(whole)))] if draws.random() < 0.2 else damaged)
        try:
            log.read(file)
        except CourseLogError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 50
