"""A run's folder is sealed at its end: whatever is changed, gone, added or replaced is found and named."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from observation.replay.record_check import check
from observation.results.seal import SUMS, Sealed, SealError, check_seal, seal, sentence
from tests.swarm.command import acrc

FLIPS_PER_FILE = 12


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two isolated robots for two seconds."""
    out = tmp_path_factory.mktemp("sealed") / "out"
    done = acrc("run", "scenarios/head_on.toml", "--duration", 2, "--out", out)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture
def damaged(sealed: Path, tmp_path: Path) -> Path:
    """A copy, to be damaged."""
    return shutil.copytree(sealed, tmp_path / "run")


def files(out: Path) -> list[Path]:
    return sorted(path for path in out.rglob("*") if path.is_file())


def fault(out: Path) -> str:
    with pytest.raises(AcrcError) as caught:
        check(out)
    said = str(caught.value)
    assert "\n" not in said
    return said


def sealed_sentence(out: Path) -> str:
    return acrc("record", "check", out).stdout.splitlines()[-1]


def test_a_run_is_sealed_and_sha256sum_reads_the_seal(sealed: Path) -> None:
    count = len(files(sealed)) - 1
    assert count > 20
    assert (
        sealed_sentence(sealed) == f"sealed: all {count} files are as they were when SHA256SUMS was written"
    )
    subprocess.run(["sha256sum", "--check", "--strict", "--quiet", SUMS], cwd=sealed, check=True)


def test_no_flipped_bit_of_any_file_passes(damaged: Path) -> None:
    passed = []
    for path in files(damaged):
        sound = path.read_bytes()
        step = max(1, len(sound) // FLIPS_PER_FILE)
        for number, at in enumerate(range(0, len(sound), step)):
            path.write_bytes(sound[:at] + bytes([sound[at] ^ 1 << number % 8]) + sound[at + 1 :])
            try:
                check_seal(damaged)
            except SealError as error:
                named = str(error).startswith(f"{path}: ")
            if not named:
                passed.append((path, at))
        path.write_bytes(sound)
    assert passed == []
    assert check_seal(damaged) is not None


@pytest.mark.parametrize("name", ["run.json", "places.csv", "scenario.toml", "r1/map.yaml", "map/map.yaml"])
def test_a_change_is_named(name: str, damaged: Path) -> None:
    path = damaged / name
    path.write_bytes(path.read_bytes() + b"\n")
    assert fault(damaged) == f"{path}: was changed; its SHA-256 is not the one in SHA256SUMS"


def test_a_better_result_is_named(damaged: Path) -> None:
    path = damaged / "run.json"
    told = path.read_text()
    assert '"contacts": 0' in told or '"contacts"' in told
    path.write_text(told.replace('"places_done": ', '"places_done": 1', 1))
    assert fault(damaged) == f"{path}: was changed; its SHA-256 is not the one in SHA256SUMS"


def test_whatever_is_removed_is_named(sealed: Path, damaged: Path) -> None:
    for path in [*files(sealed), *(sealed / name for name in ("map", "r1", "radio", "world"))]:
        gone = damaged / path.relative_to(sealed)
        shutil.rmtree(gone) if gone.is_dir() else gone.unlink()
        if gone.name == SUMS:
            assert sentence(damaged, check_seal(damaged)).startswith(
                f"not sealed: {damaged} has no SHA256SUMS"
            )
        else:
            with pytest.raises(SealError) as caught:
                check_seal(damaged)
            assert str(gone) in str(caught.value)
            assert str(caught.value).endswith(": is missing; it was there when SHA256SUMS was written")
        shutil.copytree(path, gone) if path.is_dir() else shutil.copy(path, gone)
    assert check_seal(damaged) is not None


def add_robot(out: Path) -> str:
    shutil.copytree(out / "r2", out / "r9")
    (out / "r9" / "r2.mcap").rename(out / "r9" / "r9.mcap")
    return f"{out}/r9/r9.mcap: was added; SHA256SUMS does not list it, and it lies among the run's own files"


def add_file(out: Path) -> str:
    (out / "r1" / "own" / "notes").write_text("I was here")
    return (
        f"{out}/r1/own/notes: was added; SHA256SUMS does not list it, and it lies among the run's own files"
    )


def rename(out: Path) -> str:
    (out / "r1").rename(out / "r7")
    return f"{out}/r1/map.png: is missing; it was there when SHA256SUMS was written"


def link(out: Path) -> str:
    (out / "places.csv").rename(out.parent / "elsewhere.csv")
    (out / "places.csv").symlink_to(out.parent / "elsewhere.csv")
    return f"{out}/places.csv: is no file that can be read; it was one when SHA256SUMS was written"


def link_folder(out: Path) -> str:
    (out / "map").rename(out.parent / "elsewhere")
    (out / "map").symlink_to(out.parent / "elsewhere")
    return f"{out}/map/map.png: is missing; it was there when SHA256SUMS was written"


def pipe(out: Path) -> str:
    (out / "r1" / "r1.log").unlink()
    os.mkfifo(out / "r1" / "r1.log")
    return f"{out}/r1/r1.log: is no file that can be read; it was one when SHA256SUMS was written"


def forget_a_line(out: Path) -> str:
    rows = (out / SUMS).read_text().splitlines(keepends=True)
    (out / SUMS).write_text("".join(row for row in rows if "places.csv" not in row))
    return f"{out}/SHA256SUMS: is damaged or was cut: the sum of its own lines, at its end, is another"


def link_sums(out: Path) -> str:
    (out / SUMS).rename(out.parent / SUMS)
    (out / SUMS).symlink_to(out.parent / SUMS)
    return f"{out}/SHA256SUMS: should be a file of at most 67108864 bytes, and no link"


@pytest.mark.parametrize(
    "deed", [add_robot, add_file, rename, link, link_folder, pipe, forget_a_line, link_sums]
)
def test_what_is_not_as_it_was_left_is_named(deed: Callable[[Path], str], damaged: Path) -> None:
    said = deed(damaged)
    with pytest.raises(SealError) as caught:
        check_seal(damaged)
    assert str(caught.value) == said
    with pytest.raises(AcrcError):
        check(damaged)


def test_what_is_drawn_later_is_told_and_views_are_no_part_of_it(damaged: Path) -> None:
    for name in ("view.rrd", "r1/r1.trace", "run.png", "tables/places.csv", "line\nbreak"):
        (damaged / name).parent.mkdir(exist_ok=True)
        (damaged / name).write_text("drawn")
    assert sealed_sentence(damaged).endswith("; added since: 3 (line\\nbreak, run.png, tables/places.csv)")


def test_a_run_that_was_killed_or_is_older_is_said_to_be_unsealed(damaged: Path) -> None:
    (damaged / SUMS).unlink()
    assert sealed_sentence(damaged) == (
        f"not sealed: {damaged} has no SHA256SUMS, as after a run that was killed or is of an older version; "
        "changes to files beside the recordings cannot be seen"
    )


def test_what_a_strategy_leaves_cannot_hold_up_the_seal(tmp_path: Path) -> None:
    own, other = tmp_path / "r1" / "own", tmp_path / "r2" / "own"
    for folder in (own, other):
        folder.mkdir(parents=True)
    with (own / "sparse").open("wb") as file:
        file.truncate(1 << 40)
    (other / "odd\\name\n").write_text("kept")
    (other / "link").symlink_to("/etc/passwd")
    os.mkfifo(other / "pipe")
    seal(tmp_path)
    found = check_seal(tmp_path)
    assert found is not None
    assert found == Sealed(1, ("r1/own", "r2/own/link", "r2/own/pipe"), ())
    assert sentence(tmp_path, found) == (
        "sealed: all 1 files are as they were when SHA256SUMS was written; "
        "not sealed: 3 (r1/own, r2/own/link, r2/own/pipe)"
    )
    (other / "odd\\name\n").write_text("lost")
    with pytest.raises(SealError, match="was changed"):
        check_seal(tmp_path)


def test_a_folder_of_results_alone_can_be_checked(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    seal(tmp_path)
    assert sealed_sentence(tmp_path) == ("sealed: all 1 files are as they were when SHA256SUMS was written")


def test_a_seal_is_written_through_no_link(tmp_path: Path) -> None:
    folder, target = tmp_path / "run", tmp_path / "dotfile"
    folder.mkdir()
    target.write_text("mine")
    for name in (SUMS, f"{SUMS}.new"):
        (folder / name).symlink_to(target)
    seal(folder)
    assert target.read_text() == "mine" and not (folder / SUMS).is_symlink()
    assert check_seal(folder) == Sealed(0, (), ())
