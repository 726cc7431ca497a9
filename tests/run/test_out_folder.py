"""Folders for results that cannot be used, or fill up, and two that are wanted at once."""

import errno
import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.processes.signals import Interrupted
from actors.runtime.errors import AcrcError
from deploy.run import out_folder
from deploy.run.options import RunOptions, checked, folder_name
from deploy.run.out_folder import claim, make_folder, writing
from tests import in_process
from tests.swarm.command import ACRC, ROOT, processes_of

APART = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-c")
NEW = "must be a folder that is new or empty"


def test_runs_that_begin_in_the_same_second_get_a_folder_each(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(lambda _: claim(tmp_path / "runs", "corridor-1"), range(8)))
    names = {"corridor-1", *(f"corridor-1-{number}" for number in range(2, 9))}
    assert {folder.name for folder in folders} == names
    assert all(folder.is_dir() and folder.parent == tmp_path / "runs" for folder in folders)


def test_a_folder_that_was_claimed_in_vain_is_dropped_unless_something_is_in_it(tmp_path: Path) -> None:
    for content in ((), ("log",)):
        folder = claim(tmp_path, "one")
        with pytest.raises(ZeroDivisionError), out_folder.dropped_if_empty(folder):
            for name in content:
                (folder / name).touch()
            raise ZeroDivisionError
        assert folder.exists() == bool(content)


def test_a_name_that_could_not_be_part_of_an_address_is_spelled_otherwise() -> None:
    assert folder_name(Path("there/a #1?.toml")).startswith("a--1--")
    assert folder_name(Path("größe.v2.toml")).startswith("größe.v2-")


@pytest.mark.parametrize("mark", ["?", "#"])
def test_marks_that_end_the_address_of_a_socket_are_refused_over_the_mesh_only(
    tmp_path: Path, mark: str
) -> None:
    out = tmp_path / f"a{mark}b" / "c"
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(out))
    assert str(caught.value) == (
        f'--out: {out} has a "{mark}", which cannot be part of a socket\'s address; '
        "must be a folder without one, or stand with --bus memory"
    )
    assert checked(RunOptions(out, bus="memory")).out == out


def test_a_run_below_a_link_or_a_step_back_is_recorded_where_that_leads(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "link").symlink_to("far")
    for number, way in enumerate(("link", "far/../link", "link/../far")):
        words = ("--robots", 1, "--duration", 1, "--bus", "memory")
        done = in_process.acrc("run", *words, "--out", tmp_path / way / str(number))
        assert done.returncode == 0, done.stderr
        assert f"\nrecorded in {tmp_path}/far/{number}\n" in done.stdout
    assert claim(tmp_path / "link", "one") == tmp_path / "far" / "one"


def test_what_was_recorded_is_named_by_what_ends_a_run_if_it_is_there(tmp_path: Path) -> None:
    for content in ((), ("world.mcap",)):
        folder = claim(tmp_path, "one")
        with pytest.raises(Interrupted) as caught, out_folder.dropped_if_empty(folder):
            for name in content:
                (folder / name).touch()
            raise Interrupted(130)
        assert caught.value.recorded == (folder if content else None)


@pytest.mark.parametrize(
    ("below", "sentence"),
    [
        ("file", f"is a file; {NEW}"),
        ("loop/x", f"cannot be used: too many levels of symbolic links; {NEW}"),
        ("x" * 300, f"cannot be used: file name too long; {NEW}"),
    ],
)
def test_what_can_be_no_folder_is_refused_before_anything_starts(
    tmp_path: Path, below: str, sentence: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    out = tmp_path / below
    shown = str(out) if len(str(out)) <= 200 else f"{str(out)[:200]}…"
    with pytest.raises(AcrcError) as caught:
        out_folder.checked(out, mesh=True)
        make_folder(out)
    assert str(caught.value).startswith(f"--out: {shown} ")
    assert str(caught.value).removeprefix(f"--out: {shown} ") in (
        sentence,
        f"{sentence.partition(';')[0].replace('used', 'made')}; choose another place",
    )


def test_a_folder_below_a_file_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = in_process.acrc("run", "--duration", 1, "--bus", "memory", "--out", tmp_path / "file" / "x" / "y")
    assert (done.returncode, done.stdout, done.stderr) == (
        1, "", f"acrc: --out: {tmp_path}/file/x/y cannot be made: not a directory; choose another place\n"
    )  # fmt: skip


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT])
def test_what_the_disk_refuses_is_one_sentence_and_what_we_do_wrong_is_not(
    tmp_path: Path, number: int
) -> None:
    words = os.strerror(number).lower()
    with pytest.raises(AcrcError) as caught, writing(tmp_path):
        raise OSError(number, os.strerror(number))
    assert str(caught.value) == f"{tmp_path}: cannot be written: {words}"
    with pytest.raises(AcrcError) as caught, writing(tmp_path):
        raise OSError(number, os.strerror(number), str(tmp_path / "run.json"))
    assert str(caught.value) == f"{tmp_path / 'run.json'}: cannot be written: {words}"
    with pytest.raises(FileNotFoundError), writing(tmp_path):
        raise FileNotFoundError(errno.ENOENT, "no such file", "ours")
    with pytest.raises(AcrcError, match=r"^as it was$"), writing(tmp_path):
        raise AcrcError("as it was")


@pytest.mark.skipif(sys.platform != "linux", reason="mounts a small file system")
def test_a_disk_that_fills_up_in_a_run_is_the_cause_that_is_named(tmp_path: Path) -> None:
    out = tmp_path / "small" / "out"
    (tmp_path / "small").mkdir()
    command = f"mount -t tmpfs -o size=700k tmpfs {tmp_path}/small && exec $0 $@"
    done = subprocess.run(
        [*APART, command, *ACRC, "run", "--duration", "600", "--json", "--out", str(out)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    last = done.stderr.splitlines()[-1]
    assert last.startswith("acrc: ") and last.endswith("cannot be written: no space left on device")
    assert processes_of(out) == []


@pytest.mark.nightly
def test_a_file_that_may_not_grow_is_named_with_the_cause(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = subprocess.run(
        [*ACRC, "run", "--duration", "600", "--bus", "memory", "--json", "--out", str(out)],
        cwd=ROOT, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000)),
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    file = done.stderr.removeprefix("acrc: ").partition(":")[0]
    assert done.stderr == f"acrc: {file}: cannot be written: file too large\n"
    assert Path(file).suffix == ".mcap" and Path(file).is_relative_to(out)
