"""The table of digests: what is run, what is said where something is missing, and when it is content."""

import shutil
import sys
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from benchmarks.processors import aarch64, computer, pythons, table
from benchmarks.processors.computer import Computer, RunOutcome, RunTask, last_words, make
from benchmarks.processors.table import ProcessorRow, digests, line, measure, tasks, verdict


def row(name: str, **outcomes: RunOutcome) -> ProcessorRow:
    return ProcessorRow(name, outcomes)


def test_both_tasks_are_those_of_the_house_test_and_the_chapter() -> None:
    crowd, chapter = tasks(600.0, 90.0)
    assert crowd.scenario == REPOSITORY / "tests" / "swarm" / "crowd.toml" and crowd.robots is None
    assert chapter.words(Path("o")) == [
        "run", str(REPOSITORY / "scenarios" / "chapter.toml"), "--duration", "600", "--robots", "4",
        "--navigation", "chapter", "--bus", "memory", "--json", "--out", "o",
    ]  # fmt: skip


def test_this_processor_is_measured_with_each_part_of_its_arithmetic_as_an_older_one_has_it() -> None:
    computers = computer.here()
    assert next(computer.command for computer in computers if computer.command) == (sys.executable,)
    assert [set(computer.environment) for computer in computers[2:4]] == [
        set(computer.NO_FMA),
        set(computer.GENERIC),
    ]
    assert set(computer.NO_FMA) | set(computer.GENERIC) <= set(computers[4].environment)


def test_what_is_missing_is_said_in_the_table(tmp_path: Path) -> None:
    absent = Computer("Python 3.99", missing="no such interpreter was found")
    task = RunTask("crowd", tmp_path / "none.toml", 1.0)
    (found,) = measure([task], [absent], tmp_path, lambda row: None)
    assert line(found) == f"{'Python 3.99':44s} {'-':12s}  no such interpreter was found"


def test_a_run_that_fails_says_its_last_words(tmp_path: Path) -> None:
    task = RunTask("crowd", tmp_path / "none.toml", 1.0)
    outcome = make(task, Computer("here", (sys.executable,)), tmp_path, 60.0)
    assert not outcome.digest and outcome.fault.startswith("failed: ") and "none.toml" in outcome.fault
    assert last_words("one\ntwo\n") == "failed: two" and last_words("") == "failed: without a word"


def test_the_verdict() -> None:
    rows = [
        row("a", crowd=RunOutcome("1")),
        row("b", crowd=RunOutcome("1")),
        row("c", crowd=RunOutcome("", "missing")),
    ]
    assert digests(rows, "crowd") == {"1"}
    assert verdict({"1"}) == "one digest" and verdict(set()) == "no digest"
    assert verdict(digests([*rows, row("d", crowd=RunOutcome("2"))], "crowd")) == (
        "2 digests, where there should be one"
    )


def test_a_run_that_fails_on_a_computer_that_is_there_is_a_fault_and_a_missing_computer_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent = Computer("Python 3.99", missing="no such interpreter was found")
    broken = Computer("a broken one", ("/bin/false",))
    monkeypatch.setattr(table, "make", lambda task, computer, *_: (
        RunOutcome("1") if computer.name == "well" else make(task, computer, tmp_path, 60.0)
    ))  # fmt: skip
    (lost,) = measure([RunTask("t", tmp_path, 1.0)], [absent], tmp_path, lambda row: None)
    (worse,) = measure([RunTask("t", tmp_path, 1.0)], [broken], tmp_path, lambda row: None)
    assert not table.failed(lost) and table.failed(worse)
    well = Computer("well", ("/bin/true",))
    for there, holds in (([absent, well], True), ([absent, broken, well], False)):
        monkeypatch.setattr(table, "computers", lambda *_, there=there: there)
        assert table.check(1.0, folder=tmp_path).holds is holds


def test_what_is_not_wanted_is_not_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pythons, "_computer", lambda name, *_: Computer(name, missing="built"))
    monkeypatch.setattr(aarch64, "computer", lambda *_: Computer(aarch64.NAME, missing="built"))
    assert [one.name for one in table.computers(tmp_path, False, ["aarch64"])] == [aarch64.NAME]
    assert [one.name for one in table.computers(tmp_path, False, ["Python 3.14", "FMA"])] == [
        "glibc without AVX2 and FMA",
        "Python 3.14",
    ]
    assert len(list(table.computers(tmp_path, False))) >= 9


def test_pins_are_those_of_the_python_with_their_hashes() -> None:
    older, newer = pythons.pins(11), pythons.pins(14)
    names = [[pin.partition("==")[0] for pin in pins] for pins in (older, newer)]
    assert names[0].count("numpy") == 1 and sorted(names[0]) == sorted(names[1])
    assert set(older) != set(newer) and "pymunk" in names[0] and "pytest" not in names[0]
    assert all(" --hash=sha256:" in pin and ";" not in pin for pin in (*older, *newer))


def test_an_emulator_that_is_not_there_is_said_with_what_brings_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None if "qemu" in name else f"/usr/bin/{name}")
    found = aarch64.computer(tmp_path, install=False)
    assert (found.name, found.missing) == (
        aarch64.NAME,
        "qemu-aarch64-static not found; --install, or: sudo apt install qemu-user-static",
    )
    assert table.line(row(found.name, crowd=RunOutcome("", found.missing))).endswith(found.missing)
