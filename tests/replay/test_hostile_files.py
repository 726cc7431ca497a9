"""Malicious files: one-sentence errors, and no writing through links."""

import os
import shutil
import time
import tracemalloc
from pathlib import Path

import pytest

from acrc_testbed.experiments import campaign, store
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_record import TrialRecord, write_json
from actors.floor.map_file import load_map
from actors.processes.robot_logs import last_line
from actors.robot_model import load_model
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation import credentials
from cleaning.task import CleaningTask
from deploy.fleet.collect import collect
from deploy.fleet.fleet_file import load_fleet
from deploy.scenario.scenario_file import load_scenario
from tests.in_process import acrc

SECONDS = 3.0
"""Limit on a busy machine; quadratic time takes minutes."""
TOMLS = {
    "dotted keys": "a." * 100_000 + "a = 1",
    "a dotted table": "[" + "a." * 100_000 + "a]",
    "lists in lists": "a = " + "[" * 100_000,
    "a hexadecimal number": "a = 0x" + "f" * 5000,
    "a number beyond any float": "[deeco]\npublish = " + "1" * 400,
    "an open text": 'a = """' + "\\" * 900_000,
    "unknown keys": "[deeco]\n" + "".join(f"k{number} = 1\n" for number in range(30_000)),
    "places of a wrong type": "[[robot]]\nplaces = [" + "3, " * 100_000 + "]",
    "a key of many parts": 'a = """\na.b\n""" # ' + "a." * 50 + "\n\n" + "b." * 32 + "b = 1",
}


@pytest.mark.parametrize("name", [*TOMLS, "a map whose YAML refers to itself"])
def test_malicious_text(tmp_path: Path, name: str) -> None:
    path = tmp_path / "file.toml"
    bombs = "".join(f"  - &b{n} [{', '.join([f'*b{n - 1}'] * 9)}]\n" for n in range(1, 12))
    head = "resolution: 0.05\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    path.write_text(TOMLS.get(name, f"{head}origin: [0, 0, 0]\nimage:\n  - &b0 [1]\n{bombs}"))
    for reader in (load_scenario, load_fleet, load_map, lambda path: load_model(str(path))):
        began = time.process_time()
        with pytest.raises(AcrcError) as caught:
            reader(path)
        assert time.process_time() - began < SECONDS
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_null_characters_and_link_loops_are_rejected(tmp_path: Path) -> None:
    path, loop = tmp_path / "file.toml", tmp_path / "loop.toml"
    path.write_text('map = "a\\u0000b"\n')
    with pytest.raises(AcrcError, match=r'"a\\u0000b", but must be the '):
        load_scenario(path)
    loop.symlink_to(loop)
    for reader in (load_scenario, load_fleet):
        with pytest.raises(AcrcError, match="Too many levels of symbolic links"):
            reader(loop)
    robot = tmp_path / "runs" / "r1"
    robot.mkdir(parents=True)
    (robot / "r1.mcap").symlink_to(robot / "r1.mcap")
    with pytest.raises(AcrcError, match=r"r1\.mcap: is a symbolic link, not a recording"):
        collect([tmp_path / "runs"])


def test_folder_in_place_of_the_router_socket(tmp_path: Path) -> None:
    robot, world = tmp_path / "r1", tmp_path / "world"
    for folder in (robot, world):
        folder.mkdir()
    credentials.write_router_file(world / "router.json", credentials.issue({"r1": robot}, world))
    (robot / "router.sock").mkdir()
    with pytest.raises(AcrcError, match=r"^files of the run could not be removed: "):
        credentials.remove_router_file(world / "router.json")
    assert list(world.iterdir()) == [] and [path.name for path in robot.iterdir()] == ["router.sock"]


def test_control_characters_are_escaped_and_log_ends_are_read(tmp_path: Path) -> None:
    assert str(AcrcError("r1 \x1b[2J\x9b31m\x07 says \u202eabc\ud800\r")) == (
        r"r1 \x1b[2J\x9b31m\x07 says \u202eabc\ud800\r"
    )
    assert printable("ä → \t b\n") == "ä → \t b\n"
    path = tmp_path / "r1.log"
    path.write_bytes(b"first\n" + bytes(50_000_000) + b"\n the \x1b[2Jlast \xff\n\n")
    tracemalloc.start()
    assert last_line(path) == "the \\x1b[2Jlast \ufffd"
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
    assert last_line(tmp_path / "none.log") == ""


SECRET = "content of a file in the home folder\n"


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    file = tmp_path / "home" / ".profile"
    file.parent.mkdir()
    file.write_text(SECRET)
    return file


def test_outputs_replace_links_and_are_not_written_through_them(copy: Path, victim: Path) -> None:
    for name, words in (
        ("run.png", ("view", copy, "--png")),
        ("tables/poses.parquet", ("export", copy)),
        ("report/report.html", ("report", copy)),
    ):
        link = copy / name
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(victim)
        done = acrc(*words)
        assert done.returncode == 0, done.stderr
        assert victim.read_text() == SECRET
        assert link.is_file() and not link.is_symlink() and link.stat().st_size > 100
    assert not list(copy.rglob(".*"))
    shutil.rmtree(copy / "tables")
    (copy / "tables").symlink_to(victim.parent)
    done = acrc("export", copy)
    assert done.stderr.startswith(f"acrc: {copy / 'tables'}: cannot be written: is a symbolic link")
    assert [path.name for path in victim.parent.iterdir()] == [victim.name]


def test_file_replacement_is_atomic(tmp_path: Path) -> None:
    path = tmp_path / "run.png"
    path.write_text("before")
    with pytest.raises(ZeroDivisionError), regular_file.atomic_replacement(path) as part:
        part.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "before" and [*tmp_path.iterdir()] == [path]
    regular_file.write_atomically(path, b"after")
    assert path.read_text() == "after" and [*tmp_path.iterdir()] == [path]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask
    with pytest.raises(OSError) as caught:
        regular_file.write_atomically(tmp_path / "none" / "run.png", b"")
    assert caught.value.filename == str(tmp_path / "none" / "run.png")


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def _huge(path: Path) -> None:
    path.unlink()
    with path.open("wb") as file:
        file.truncate(1 << 34)  # sparse


READ = (
    ("scenario.toml", "run {out}/scenario.toml --out {to} --bus memory"),
    ("scenario.toml", "replay {out}"),
    ("map/map.png", "run {out}/scenario.toml --out {to} --bus memory"),
    ("r1/map.yaml", "replay {out} --robot r1 --to 1"),
    ("r1/r1.mcap", "record check {out}"),
    ("map/map.yaml", "causes {out}"),
    ("run.json", "report {out}"),
)
"""Files of a run, and commands that read them."""


@pytest.mark.timeout(120)
@pytest.mark.parametrize(("name", "words"), READ)
def test_pipes_devices_and_huge_files_are_refused(copy: Path, tmp_path: Path, name: str, words: str) -> None:
    for plant in (_pipe, _device, _huge):
        plant(copy / name)
        done = acrc(*words.format(out=copy, to=tmp_path / "to").split())
        assert done.returncode == 1 and done.stderr.startswith("acrc: "), done.stdout
        (last,) = done.stderr.splitlines()[-1:]
        assert str(copy) in last or "/dev/zero" in last, last
    for reader in (load_scenario, load_map):
        with pytest.raises(AcrcError, match=r"larger than|has more"):
            reader(copy / name)


def test_nothing_is_written_through_links_in_a_campaigns_folder(tmp_path: Path, victim: Path) -> None:
    study = Study(
        name="received",
        task=CleaningTask.declaration,
        scenario="/nowhere/scenario.toml",
        strategies=("none", "chapter"),
        seeds=2,
    )
    kept = store.create_store(tmp_path / "received", study)
    for trial in study.trials():
        write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, failure="it never was"))
    for name in ("results.csv", "results.parquet", "results.new", "study.new"):
        (kept.folder / name).unlink(missing_ok=True)
        (kept.folder / name).symlink_to(victim)
    campaign.write_tables(kept)
    store.create_store(kept.folder, kept.study)
    assert victim.read_text() == SECRET
    table = kept.folder / "results.csv"
    assert table.stat().st_size > 100 and not table.is_symlink()
    shutil.rmtree(kept.folder / "trials")
    (kept.folder / "trials").symlink_to(victim.parent)
    with pytest.raises(AcrcError, match="trials: is a symbolic link, and must be a folder"):
        store.create_store(kept.folder, kept.study)
