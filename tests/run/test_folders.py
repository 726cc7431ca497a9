"""Options and folders of a run: wrong ones are refused, full ones are named, copies repeat the run."""

import errno
import json
import os
import platform
import shutil
import subprocess
import tomllib
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from actors.installation.usage import OptionError
from actors.installation.version import software_version
from actors.processes import launcher
from actors.processes.launcher import scratch_folder
from actors.processes.signals import Interruption
from actors.runtime.errors import AcrcError
from deploy.run import out_folder
from deploy.run.options import RunOptions, check_options, run_folder_name
from deploy.run.out_folder import claim, convert_write_errors, make_folder
from tests.helpers import on_small_disk
from tests.in_process import acrc
from tests.swarm.command import ACRC, ROOT, processes_of

SPEED = 'must be "max" or a number of at least 0.01, such as 1 or 4'
NEW = "choose a new or empty folder"
FULL = errno.ENOSPC, "No space left on device"
SCRATCH = "{}: temporary files cannot be written: no space left on device; free space there, or set TMPDIR"
STUDY = """
from tests.swarm.reporting import behaviour as plain

def behaviour(start):
    return plain(start)
"""


def test_options_have_defaults_and_the_folder_becomes_absolute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert check_options(RunOptions(Path("runs/a"))) == RunOptions(tmp_path / "runs/a")
    for speed in ("1", "0.5", "4e2"):
        assert check_options(RunOptions(tmp_path, speed=speed)).speed == speed
    assert check_options(RunOptions(tmp_path, bus="memory", isolate=False)).isolate is False


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        *(({"speed": speed}, f"--speed: {speed or repr('')}; {SPEED}")
          for speed in ("fast", "0.009", "-1", "nan", "inf", "", "1x")),
        ({"bus": "ether"}, "--bus: ether; must be zenoh or memory"),
        ({"spawn": "fork"}, "--spawn: fork; must be forkserver or exec"),
        ({"bus": "memory", "isolate": True},
         "--isolate: requires --bus zenoh; --bus memory has one process for all robots"),
        ({"bus": "memory", "view": True},
         "--view: requires --bus zenoh; --bus memory has one process for all"),
        ({"followed": ("r2",)}, "--robot: 'r2'; requires --view; --robots sets the number of robots"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(tmp_path: Path, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(OptionError) as caught:
        check_options(RunOptions(tmp_path, **options))
    assert str(caught.value) == sentence


def test_runs_started_in_the_same_second_get_separate_folders(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(lambda _: claim(tmp_path / "runs", "corridor-1"), range(8)))
    names = {"corridor-1", *(f"corridor-1-{number}" for number in range(2, 9))}
    assert {folder.name for folder in folders} == names
    assert all(folder.is_dir() and folder.parent == tmp_path / "runs" for folder in folders)


@pytest.mark.parametrize("content", [(), ("world.mcap",)])
def test_a_claimed_folder_is_removed_if_empty_and_named_if_not(
    tmp_path: Path, content: tuple[str, ...]
) -> None:
    for error in (ZeroDivisionError(), Interruption(130)):
        folder = claim(tmp_path, "one")
        with pytest.raises(type(error)), out_folder.remove_if_empty(folder):
            for name in content:
                (folder / name).touch()
            raise error
        assert folder.exists() == bool(content)
    assert isinstance(error, Interruption) and error.recorded == (folder if content else None)


@pytest.mark.parametrize("mark", ["?", "#"])
def test_marks_that_end_a_sockets_address_are_refused_over_the_mesh_only(tmp_path: Path, mark: str) -> None:
    assert run_folder_name(Path(f"there/a {mark}1.toml")).startswith("a--1-2")
    assert run_folder_name(Path("a.toml"), f"b{mark}:c").startswith("a-b--c-2")
    out = tmp_path / f"a{mark}b" / "c"
    with pytest.raises(OptionError) as caught:
        check_options(RunOptions(out))
    assert str(caught.value) == (
        f'--out: {out} contains "{mark}", which a socket address cannot; '
        "choose another folder, or use --bus memory"
    )
    assert check_options(RunOptions(out, bus="memory")).out == out


def test_links_and_parent_steps_in_a_path_are_resolved(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "link").symlink_to("far")
    for number, way in enumerate(("link", "far/../link", "link/../far")):
        words = ("--robots", 1, "--duration", 1, "--bus", "memory")
        done = acrc("run", *words, "--out", tmp_path / way / str(number))
        assert done.returncode == 0, done.stderr
        assert f"\nRecordings: {tmp_path}/far/{number}\n" in done.stdout
    assert claim(tmp_path / "link", "one") == tmp_path / "far" / "one"


@pytest.mark.parametrize(
    ("below", "sentence"),
    [
        ("file", f"is a file; {NEW}"),
        ("file/x/y", "cannot be created: not a directory; choose another folder"),
        ("loop/x", f"cannot be used: too many levels of symbolic links; {NEW}"),
        ("x" * 300, f"cannot be used: file name too long; {NEW}"),
    ],
)
def test_invalid_output_folders_are_refused_before_the_start(
    tmp_path: Path, below: str, sentence: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    out = tmp_path / below
    shown = str(out) if len(str(out)) <= 200 else f"{str(out)[:200]}…"
    with pytest.raises(AcrcError) as caught:
        out_folder.checked_path(out, mesh=True)
        make_folder(out)
    assert str(caught.value).startswith(f"--out: {shown} ")
    assert str(caught.value).removeprefix(f"--out: {shown} ") in (
        sentence,
        f"{sentence.partition(';')[0].replace('used', 'created')}; choose another folder",
    )


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_errors_of_the_disk_are_one_sentence_and_others_pass(tmp_path: Path, number: int) -> None:
    words = os.strerror(number).lower()
    with pytest.raises(AcrcError) as caught, convert_write_errors(tmp_path):
        raise OSError(number, os.strerror(number))
    assert str(caught.value) == f"{tmp_path}: cannot be written: {words}"
    with pytest.raises(AcrcError) as caught, convert_write_errors(tmp_path):
        raise OSError(number, os.strerror(number), str(tmp_path / "run.json"))
    assert str(caught.value) == f"{tmp_path / 'run.json'}: cannot be written: {words}"
    with pytest.raises(FileNotFoundError), convert_write_errors(tmp_path):
        raise FileNotFoundError(errno.ENOENT, "no such file", "ours")
    with pytest.raises(AcrcError, match=r"^as it was$"), convert_write_errors(tmp_path):
        raise AcrcError("as it was")


def test_a_disk_that_fills_up_in_a_run_is_named(tmp_path: Path) -> None:
    out = tmp_path / "small" / "out"
    words = [*ACRC, "run", "--robots", "1", "--duration", "600", "--json", "--out", str(out)]
    done = subprocess.run(
        on_small_disk(out.parent, "700k", words), cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    last = done.stderr.splitlines()[-1]
    assert last.startswith("acrc: ") and last.endswith("cannot be written: no space left on device")
    assert processes_of(out) == []


def test_a_scratch_folder_is_removed_and_errors_with_another_cause_pass() -> None:
    for error in (ZeroDivisionError(), OSError(*FULL), AcrcError("r1 failed")):
        with pytest.raises(type(error)) as caught, scratch_folder() as folder:
            (folder / "a").write_text("a")
            raise error
        assert caught.value is error, "there is room here"
        assert not folder.exists()


def test_a_full_or_missing_scratch_folder_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launcher, "write_fault", lambda folder: "no space left on device")
    for error, prefix in ((OSError(*FULL), ""), (AcrcError("r1 has ended"), "r1 has ended; ")):
        with pytest.raises(AcrcError) as caught, scratch_folder() as folder:
            raise error
        assert str(caught.value) == prefix + SCRATCH.format(folder.parent)

    def nowhere(prefix: str) -> None:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("tempfile.TemporaryDirectory", nowhere)
    monkeypatch.setenv("TMPDIR", "/somewhere")
    with pytest.raises(AcrcError) as caught, scratch_folder():
        raise AssertionError
    assert str(caught.value) == (
        "/somewhere: temporary files cannot be written: no usable temporary directory found in ['/tmp']; "
        "free space there, or set TMPDIR"
    )


def test_a_run_names_its_full_scratch_folder_and_not_its_own(tmp_path: Path) -> None:
    full, out = tmp_path / "full", tmp_path / "out"
    words = ("run", "--robots", "1", "--duration", "1", "--out", str(out))
    done = subprocess.run(
        on_small_disk(full, "8k", [*ACRC, *words]), cwd=ROOT, env={**os.environ, "TMPDIR": str(full)},
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines()[-1] == f"acrc: {SCRATCH.format(full)}"
    assert not out.exists()


def run(out: Path, *words: object) -> dict[str, Any]:
    done = acrc("run", *words, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def scenario_file(folder: Path) -> Path:
    folder.mkdir()
    for image in (ROOT / "maps").glob("corridor.*"):
        shutil.copy(image, folder)
    shutil.copy(ROOT / "actors/models/turtlebot2.toml", folder / "mine.toml")
    (folder / "my_own_study.py").write_text(STUDY)
    file = folder / "study.toml"
    file.write_text(
        'map = "corridor.yaml"\n[run]\nduration = 2.0\nstrategy = "my_own_study:behaviour"\n'
        '[robots]\ncount = 2\nmodel = "mine.toml"\n'
    )
    return file


def test_a_result_has_its_origin_and_can_be_reproduced_elsewhere(tmp_path: Path) -> None:
    study = scenario_file(tmp_path / "study")
    first = run(tmp_path / "one" / "out", study, "--trust", "--bus", "memory")
    origin = first["origin"]
    assert origin == json.loads((tmp_path / "one" / "out" / "run.json").read_text())["origin"]
    assert origin["versions"].pop("python") == platform.python_version()
    assert origin["versions"].items() >= {"numpy": version("numpy"), "numba": version("numba")}.items()
    del origin["versions"]
    strategy = "my_own_study:behaviour"
    assert origin == {
        "scenario": "study.toml", "strategy": strategy, "behaviour": strategy, "settings": {}, "key": "",
        "commit": software_version(), "navigation": "robust", "localisation": "robust", "branch": None,
    }  # fmt: skip
    text = (tmp_path / "one" / "out" / "scenario.toml").read_text()
    assert str(tmp_path) not in text and str(ROOT) not in text
    said = tomllib.loads(text)
    assert said["map"] == "map/map.yaml" and said["run"]["modules"] == "../../study"
    assert said["robots"]["model"] == said["robot"][0]["model"] == "models/1-mine.toml"
    (tmp_path / "one").rename(tmp_path / "two")
    again = run(tmp_path / "again", tmp_path / "two" / "out" / "scenario.toml", "--trust", "--bus", "memory")
    assert again["digest"] == first["digest"]


def test_a_shipped_strategy_needs_nothing_from_outside_of_the_folder(tmp_path: Path) -> None:
    words = ("--bus", "memory", "--duration", 1, "--robots", 1, "--strategy", "chapter")
    first = run(tmp_path / "a" / "out", *words)
    assert first["origin"]["scenario"] == "chapter.toml" and first["origin"]["strategy"] == "chapter"
    said = tomllib.loads((tmp_path / "a" / "out" / "scenario.toml").read_text())
    assert "modules" not in said["run"]
    subprocess.run(["cp", "-r", tmp_path / "a" / "out", tmp_path / "b"], check=True)
    shutil.rmtree(tmp_path / "a")
    again = run(tmp_path / "c", tmp_path / "b" / "scenario.toml", "--bus", "memory")
    assert again["digest"] == first["digest"]
