"""The check of bundles: which computers it tries, what it makes of a fault, and how a system is entered."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.hardware import bundled
from benchmarks.hardware.bundled import BundleRow
from benchmarks.processors import debian
from benchmarks.processors.building import NotBuiltError, do, once


def test_a_computer_that_is_not_to_be_had_is_said_and_proves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    found = bundled.check(folder=tmp_path)
    assert [row["missing"] for row in found.figures] == ["entering a system of its own requires root"] * 2
    assert found.holds is None
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    (row,) = bundled.check(only=["x86-64"], folder=tmp_path).figures
    assert row["missing"] == "debootstrap not found; --install, or: sudo apt install debootstrap"
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(("faults", "holds"), [(("", ""), True), (("", "it stood"), False)])
def test_it_holds_where_no_robot_has_a_fault(
    faults: tuple[str, str], holds: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = list(faults)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(debian, "system", lambda place, machine: None)
    monkeypatch.setattr(bundled, "_row", lambda row, *_: replace(row, fault=left.pop(0)))
    found = bundled.check(folder=tmp_path)
    assert [row["fault"] for row in found.figures] == list(faults) and found.holds is holds
    assert {path.name for path in tmp_path.glob("*.complete")} == {
        "debian-aarch64.complete", "debian-x86-64.complete"
    }  # fmt: skip
    assert not any(BundleRow(**row).missing for row in found.figures)


def test_whoever_enters_a_system_has_no_network_there_and_leaves_nothing_behind() -> None:
    words = debian.inside(Path("/r"), Path("/s"), "x86-64", ("ls", "/"))
    options = words[1 : words.index("sh")]
    assert words[0] == "unshare" and {"--net", "--mount", "--pid", "--kill-child"} <= set(options)
    assert words[-2:] == ("ls", "/")
    assert "--net" not in debian.inside(Path("/r"), Path("/s"), "x86-64", ("ls",), network=True)


def test_what_failed_is_built_again_and_what_is_complete_is_not(tmp_path: Path) -> None:
    place = tmp_path / "system"

    def half(folder: Path) -> None:
        (folder / "half").touch()
        do("sh", "-c", "echo no room; exit 3")

    with pytest.raises(NotBuiltError, match=r"^sh -c failed with exit code 3: no room$"):
        once(place, half)
    once(place, lambda folder: (folder / "whole").touch())
    once(place, half)
    assert [path.name for path in place.iterdir()] == ["whole"]
