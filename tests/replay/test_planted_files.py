"""Links and things that are no files in a folder that came from elsewhere: nothing is written out of it, and
nobody waits for what never ends."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.floor.map_file import load_map
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import load_scenario
from experiments.campaign import results_table, store
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.study.study import Study
from tests.swarm.command import acrc

SECRET = "what the user has in his home folder\n"


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """A file of the user's to which links lead."""
    file = tmp_path / "home" / ".profile"
    file.parent.mkdir()
    file.write_text(SECRET)
    return file


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("run.png", ("view", "{out}", "--png")),
        ("run.svg", ("view", "{out}", "--svg")),
        ("run.html", ("view", "{out}", "--html")),
        ("beside.png", ("view", "{out}", "--beside", "{out}", "--png")),
        ("run.gif", ("view", "{out}", "--movie", "{out}/run.gif", "--speed", "100")),
        ("tables/poses.parquet", ("export", "{out}")),
        ("report/report.html", ("report", "{out}")),
        ("report/origin.csv", ("report", "{out}")),
    ],
)
def test_what_is_written_takes_a_links_place(
    copy: Path, victim: Path, name: str, words: tuple[str, ...]
) -> None:
    link = copy / name
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(victim)
    done = acrc(*(word.format(out=copy) for word in words))
    assert done.returncode == 0, done.stderr
    assert victim.read_text() == SECRET
    if name != "report/origin.csv":
        assert link.is_file() and not link.is_symlink() and link.stat().st_size > 100
    assert not list(copy.rglob(".*"))


@pytest.mark.parametrize(("name", "command"), [("tables", "export"), ("report", "report")])
def test_nothing_is_written_through_a_linked_folder(
    copy: Path, victim: Path, name: str, command: str
) -> None:
    (copy / name).symlink_to(victim.parent)
    done = acrc(command, copy)
    assert (done.returncode, done.stderr) == (
        1,
        f"acrc: {copy / name}: cannot be written: is a link, through which nothing is written\n",
    )
    assert [path.name for path in victim.parent.iterdir()] == [victim.name]


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "run.png"
    path.write_text("before")
    with pytest.raises(ZeroDivisionError), regular_file.replaced(path) as part:
        part.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "before" and [*tmp_path.iterdir()] == [path]
    regular_file.write(path, b"after")
    assert path.read_text() == "after" and [*tmp_path.iterdir()] == [path]
    assert path.stat().st_mode & 0o777 == 0o666 & ~_umask()
    with pytest.raises(OSError) as caught:
        regular_file.write(tmp_path / "none" / "run.png", b"")
    assert caught.value.filename == str(tmp_path / "none" / "run.png")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def _huge(path: Path) -> None:
    path.unlink()
    with path.open("wb") as file:
        file.truncate(1 << 34)  # sixteen gigabytes that take no place


READ = [
    ("scenario.toml", ("run", "{out}/scenario.toml", "--out", "{to}", "--bus", "memory")),
    ("scenario.toml", ("replay", "{out}")),
    ("scenario.toml", ("scenario", "{out}/scenario.toml")),
    ("map/map.yaml", ("run", "{out}/scenario.toml", "--out", "{to}", "--bus", "memory")),
    ("map/map.png", ("run", "{out}/scenario.toml", "--out", "{to}", "--bus", "memory")),
    ("r1/map.yaml", ("replay", "{out}", "--robot", "r1", "--to", "1")),
    ("r1/map.png", ("explain", "{out}", "r1")),
    ("r1/r1.mcap", ("record", "check", "{out}")),
    ("map/map.yaml", ("replay", "{out}", "--robot", "world")),
    ("map/map.yaml", ("causes", "{out}")),
    ("run.json", ("report", "{out}")),
]
"""A file of a run, and a command that reads it."""
LOG = ("r1/r1.log", ("record", "echo", "{out}", "*/log"))
"""A log may be long, and a link to a device is none that a robot can lay."""


@pytest.mark.parametrize(
    ("plant", "name", "words"),
    [*((plant, *row) for plant in (_pipe, _device, _huge) for row in READ), (_pipe, *LOG)],
)
def test_what_is_no_file_or_has_no_end_is_one_sentence(
    copy: Path, tmp_path: Path, plant: Callable[[Path], None], name: str, words: tuple[str, ...]
) -> None:
    (copy / "r1" / "r1.log").touch()
    plant(copy / name)
    done = acrc(*(word.format(out=copy, to=tmp_path / "to") for word in words), timeout_s=60.0)
    assert done.returncode == 1, done.stdout
    assert done.stderr.startswith("acrc: ") and "Traceback" not in done.stderr
    (said,) = done.stderr.splitlines()[-1:]
    assert str(copy) in said or "/dev/zero" in said, said


@pytest.mark.parametrize(
    ("plant", "scenario", "floor"),
    [
        (_pipe, "cannot be read: is no regular file", "the map cannot be read: is no regular file."),
        (_device, "cannot be read: is no regular file", "the map cannot be read: is no regular file."),
        (
            _huge,
            "may have at most 1000000 bytes, but has more",
            "the map cannot be read: has more than 65536 bytes.",
        ),
    ],
)
def test_it_is_said_what_is_wrong_with_a_file(
    tmp_path: Path, plant: Callable[[Path], None], scenario: str, floor: str
) -> None:
    path = tmp_path / "file"
    path.touch()
    plant(path)
    with pytest.raises(AcrcError) as caught:
        load_scenario(path)
    assert str(caught.value) == f"{path}: the scenario file {scenario}"
    with pytest.raises(AcrcError) as caught:
        load_map(path)
    assert str(caught.value) == f"{path}: {floor}"
    with pytest.raises(OSError, match=r"is no regular file|has more than 64000000 bytes"):
        regular_file.content(path)


def test_a_campaigns_folder_is_not_left_either(tmp_path: Path, victim: Path) -> None:
    study = Study("received", "/nowhere/scenario.toml", ("none", "chapter"), 2)
    kept = store.create(tmp_path / "received", study)
    for trial in study.trials():
        keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, failure="it never was"))
    for name in ("results.csv", "results.parquet", "results.new", "study.new"):
        (kept.folder / name).unlink(missing_ok=True)
        (kept.folder / name).symlink_to(victim)
    results_table.write(kept)
    store.create(kept.folder, kept.study)
    assert victim.read_text() == SECRET
    table = kept.folder / "results.csv"
    assert table.stat().st_size > 100 and not table.is_symlink()
    shutil.rmtree(kept.folder / "trials")
    (kept.folder / "trials").symlink_to(victim.parent)
    with pytest.raises(AcrcError) as caught:
        store.create(kept.folder, kept.study)
    assert str(caught.value) == f"{kept.folder}/trials: is a link, through which nothing is written"
