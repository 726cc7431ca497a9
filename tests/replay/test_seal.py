"""The seal of a run's folder: changed, missing, added and replaced files are detected and named."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_check import check_run
from acrc_testbed.results.seal import SUMS, SealError, SealReport, check_seal, seal, seal_sentence
from actors.runtime.errors import AcrcError
from tests.in_process import acrc

FLIPS_PER_FILE = 6


@pytest.fixture
def sealed(copy: Path) -> Path:
    seal(copy)
    return copy


def files(out: Path) -> list[Path]:
    return sorted(path for path in out.rglob("*") if path.is_file())


def fault(out: Path) -> str:
    with pytest.raises(SealError) as caught:
        check_seal(out)
    return str(caught.value)


def told(out: Path) -> str:
    return seal_sentence(out, check_seal(out))


def test_a_seal_counts_all_files_and_sha256sum_reads_it(sealed: Path) -> None:
    count = len(files(sealed)) - 1
    last = acrc("record", "check", sealed).stdout.splitlines()[-1]
    assert last == f"sealed: all {count} files match SHA256SUMS"
    subprocess.run(["sha256sum", "--check", "--strict", "--quiet", SUMS], cwd=sealed, check=True)


@pytest.mark.claim("seal")
def test_no_flipped_bit_of_any_file_passes(sealed: Path, full: bool) -> None:
    flips = 200 if full else FLIPS_PER_FILE
    for path in files(sealed):
        sound = path.read_bytes()
        for number, at in enumerate(range(0, len(sound), max(1, len(sound) // flips))):
            path.write_bytes(sound[:at] + bytes([sound[at] ^ 1 << number % 8]) + sound[at + 1 :])
            assert fault(sealed).startswith(f"{path}: "), (path, at)
        path.write_bytes(sound)
    assert check_seal(sealed) is not None


@pytest.mark.claim("seal")
def test_any_removed_file_or_folder_is_named(sealed: Path, tmp_path: Path) -> None:
    kept = shutil.copytree(sealed, tmp_path / "kept")
    for path in [*files(kept), *(kept / name for name in ("map", "r1", "radio", "world"))]:
        gone = sealed / path.relative_to(kept)
        shutil.rmtree(gone) if gone.is_dir() else gone.unlink()
        if gone.name == SUMS:
            assert told(sealed).startswith(f"not sealed: {sealed} has no SHA256SUMS, as after a killed run")
        else:
            assert fault(sealed).startswith(str(gone)) and ": missing; it is" in fault(sealed)
        shutil.copytree(path, gone) if path.is_dir() else shutil.copy(path, gone)
    assert check_seal(sealed) is not None


def change(out: Path) -> str:
    path = out / "run.json"
    path.write_text(path.read_text().replace('"places_done": ', '"places_done": 1', 1))
    return f"{path}: changed; its SHA-256 differs from SHA256SUMS"


def add_robot(out: Path) -> str:
    shutil.copytree(out / "r2", out / "r9")
    (out / "r9" / "r2.mcap").rename(out / "r9" / "r9.mcap")
    return f"{out}/r9/r9.mcap: added among the run's own files; not listed in SHA256SUMS"


def add_file(out: Path) -> str:
    (out / "r1" / "own" / "notes").write_text("I was here")
    return f"{out}/r1/own/notes: added among the run's own files; not listed in SHA256SUMS"


def link(out: Path) -> str:
    (out / "places.csv").rename(out.parent / "elsewhere.csv")
    (out / "places.csv").symlink_to(out.parent / "elsewhere.csv")
    return f"{out}/places.csv: not a readable file; it is listed in SHA256SUMS"


def link_folder(out: Path) -> str:
    (out / "map").rename(out.parent / "elsewhere")
    (out / "map").symlink_to(out.parent / "elsewhere")
    return f"{out}/map/map.png: missing; it is listed in SHA256SUMS"


def pipe(out: Path) -> str:
    (out / "r1" / "map.yaml").unlink()
    os.mkfifo(out / "r1" / "map.yaml")
    return f"{out}/r1/map.yaml: not a readable file; it is listed in SHA256SUMS"


def forget_a_line(out: Path) -> str:
    rows = (out / SUMS).read_text().splitlines(keepends=True)
    (out / SUMS).write_text("".join(row for row in rows if "places.csv" not in row))
    return f"{out}/SHA256SUMS: damaged or truncated: the checksum of its own lines does not match"


def link_sums(out: Path) -> str:
    (out / SUMS).rename(out.parent / SUMS)
    (out / SUMS).symlink_to(out.parent / SUMS)
    return f"{out}/SHA256SUMS: must be a regular file of at most 67108864 bytes"


@pytest.mark.claim("seal")
@pytest.mark.parametrize(
    "tamper", [change, add_robot, add_file, link, link_folder, pipe, forget_a_line, link_sums]
)
def test_tampering_is_named(tamper: Callable[[Path], str], sealed: Path) -> None:
    expected = tamper(sealed)
    assert fault(sealed) == expected
    with pytest.raises(AcrcError):
        check_run(sealed)


def test_files_drawn_later_are_counted_and_views_are_ignored(sealed: Path) -> None:
    for name in ("view.rrd", "run.png", "tables/places.csv", "line\nbreak"):
        (sealed / name).parent.mkdir(exist_ok=True)
        (sealed / name).write_text("drawn")
    assert told(sealed).endswith("; added since: 3 (line\\nbreak, run.png, tables/places.csv)")


def test_strategy_files_cannot_block_the_seal(tmp_path: Path) -> None:
    own, other = tmp_path / "r1" / "own", tmp_path / "r2" / "own"
    for folder in (own, other):
        folder.mkdir(parents=True)
    with (own / "sparse").open("wb") as file:
        file.truncate(1 << 40)
    (other / "odd\\name\n").write_text("kept")
    (other / "link").symlink_to("/etc/passwd")
    os.mkfifo(other / "pipe")
    seal(tmp_path)
    assert check_seal(tmp_path) == SealReport(1, ("r1/own", "r2/own/link", "r2/own/pipe"), ())
    assert told(tmp_path).endswith("; not sealed: 3 (r1/own, r2/own/link, r2/own/pipe)")
    (other / "odd\\name\n").write_text("lost")
    assert ": changed; " in fault(tmp_path)


def test_seal_does_not_follow_links(tmp_path: Path) -> None:
    folder, target = tmp_path / "run", tmp_path / "dotfile"
    folder.mkdir()
    target.write_text("mine")
    for name in (SUMS, f"{SUMS}.new"):
        (folder / name).symlink_to(target)
    seal(folder)
    assert target.read_text() == "mine" and not (folder / SUMS).is_symlink()
    assert check_seal(folder) == SealReport(0, (), ())
