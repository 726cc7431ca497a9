"""That two states run in turn, by their own `.venv`, and that nothing is left of a commit."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from benchmarks.beside import command, state
from benchmarks.beside.state import PairedCase, ProjectState, other
from benchmarks.statistics.commands import spent

ACRC = """#!/bin/sh
echo "@NAME@ $3 $4 $5 $6 PYTHONPATH=$PYTHONPATH NUMBA_CACHE_DIR=$NUMBA_CACHE_DIR" >>@LOG@
mkdir -p .venv/bin
printf '#!/bin/sh\\necho Python @VERSION@\\n' >.venv/bin/python
chmod +x .venv/bin/python
echo '{"digest": "@DIGEST@", "wall_s": @WALL@}'
"""
"""A state whose runs take no time, and say what they are asked."""


def clone(
    folder: Path, log: Path, name: str, wall: float, version: str = "3.11.7", digest: str = "d"
) -> Path:
    folder.mkdir()
    words = {"NAME": name, "LOG": str(log), "WALL": str(wall), "VERSION": version, "DIGEST": digest}
    text = ACRC
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    (folder / "acrc").write_text(text)
    (folder / "acrc").chmod(0o755)
    (folder / "scenarios").mkdir()
    (folder / "scenarios" / "chapter.toml").write_text('[run]\nseed = 1\nstrategy = "chapter"\n')
    return folder


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


@pytest.fixture
def mine(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = clone(tmp_path / "mine", log, "mine", 1.0)
    monkeypatch.setattr(state, "clone", lambda command: folder)
    monkeypatch.setattr(state, "REPOSITORY", folder)
    return folder


def test_who_was_second_is_first_next(mine: Path, tmp_path: Path, log: Path) -> None:
    theirs = clone(tmp_path / "theirs", log, "theirs", 1.5)
    found = command.measure(str(theirs), robots=(4, 20), bus="memory", pairs=3)
    lines = log.read_text().splitlines()
    assert [line.split()[0] for line in lines] == [
        *("mine", "theirs"),
        *("mine", "theirs", "theirs", "mine", "mine", "theirs") * 2,
    ]
    assert lines[0] == "mine --robots 4 --duration 2 PYTHONPATH= NUMBA_CACHE_DIR="
    assert {line.split()[4] for line in lines[2:8]} == {"120"} and {
        line.split()[4] for line in lines[8:]
    } == {"60"}
    few, many = found.figures["cases"]
    assert (
        found.figures["unlike"] == [] and few["digests_equal"] and (few["robots"], many["robots"]) == (4, 20)
    )
    times = few["times_as_fast"]["wall_s"]
    assert times == {name: pytest.approx(1.5) for name in ("value", "low", "high")}
    assert few["times_as_fast"]["command_s"]["low"] < few["times_as_fast"]["command_s"]["high"]
    assert found.shown[1] == "digests: equal"


def test_unlike_work_is_told(mine: Path, tmp_path: Path, log: Path) -> None:
    theirs = clone(tmp_path / "theirs", log, "theirs", 1.5, "3.13.1", "e")
    (theirs / "scenarios" / "chapter.toml").write_text('[run]\nseed = 1\nstrategy = "none"\nkey = 3\n')
    found = command.measure(str(theirs), robots=(4,), bus="memory", pairs=2)
    assert found.shown[1:] == [
        "digests: unlike, so the two do unlike work",
        f"here has Python 3.11.7, {theirs} Python 3.13.1: they compare Pythons, too",
        "their scenarios differ, so that their work may, too: run.strategy is chapter here, none there; "
        "run.key is not set here, 3 there; --scenario FILE has both run the same one",
    ]
    given = command.measure(
        str(theirs), robots=(4,), bus="memory", pairs=2, seed=7, scenario=mine / "scenarios" / "chapter.toml"
    )
    assert len(given.figures["unlike"]) == 1
    assert "run.strategy" not in str(given.figures["unlike"])


def test_where_more_is_installed_is_told(mine: Path, tmp_path: Path, log: Path) -> None:
    theirs = clone(tmp_path / "theirs", log, "theirs", 1.0)
    for folder, names in ((mine, ("one", "two")), (theirs, ("one",))):
        for name in names:
            place = folder / ".venv" / "lib" / "python3.11" / "site-packages" / f"{name}-1.0.dist-info"
            place.mkdir(parents=True)
    found = command.measure(str(theirs), robots=(4,), bus="memory", pairs=1)
    assert found.figures["unlike"] == [
        f"here has 2 packages in its .venv, {theirs} 1: with more of them a command starts later; "
        "a new clone has what a run needs and no more"
    ]
    assert found.shown[-1] == found.figures["unlike"][0]


def test_this_state_alone_has_another_navigation(mine: Path, tmp_path: Path, log: Path) -> None:
    theirs = clone(tmp_path / "theirs", log, "theirs", 1.5)
    for folder in (mine, theirs):
        text = (folder / "acrc").read_text()
        (folder / "acrc").write_text(text.replace("$3 $4 $5 $6", "$7 $8"))
    command.measure(str(theirs), robots=(4,), bus="memory", pairs=2, navigation="robust")
    said = {tuple(line.split()[:3]) for line in log.read_text().splitlines()}
    assert said == {("mine", "--navigation", "robust"), ("theirs", "--bus", "memory")}
    with pytest.raises(OptionError) as raised:
        command.measure(str(theirs), navigation="better")
    assert str(raised.value) == "--navigation: better; must be chapter or robust"


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=Ada", "-c", "user.email=ada@example.org")
    done = subprocess.run(["git", *who, *words], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture
def committed(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    git(mine, "init", "-q")
    git(mine, "add", ".")
    git(mine, "commit", "-q", "-m", "as it was")
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    return mine


def nothing_is_left(repository: Path, tmp_path: Path) -> bool:
    return not list((tmp_path / "scratch").iterdir()) and "\n" not in git(repository, "worktree", "list")


def test_a_commit_runs_in_a_folder_that_is_gone_afterwards(committed: Path, tmp_path: Path) -> None:
    with other("HEAD") as there:
        assert there.name == "HEAD" and there.folder != committed
        assert there.run(PairedCase(2, 1.0, "memory")).wall_s == 1.0
        assert there.python() == "Python 3.11.7"
    assert nothing_is_left(committed, tmp_path)


def test_a_run_that_fails_is_told_and_leaves_nothing(committed: Path, tmp_path: Path) -> None:
    (committed / "acrc").write_text("#!/bin/sh\necho 'acrc: no disk' >&2\nexit 1\n")
    git(committed, "commit", "-q", "-a", "-m", "fails")
    with pytest.raises(AcrcError) as caught, other("HEAD") as there:
        there.run(PairedCase(2, 1.0, "memory"))
    assert str(caught.value).endswith(" fails: acrc: no disk") and "acrc run " in str(caught.value)
    assert nothing_is_left(committed, tmp_path)


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ("deadbeef", "COMMIT: deadbeef; must be a commit of this repository, or the folder of a clone"),
        ("--force", "COMMIT: --force; must be a commit of this repository, or the folder of a clone"),
        ("empty", "COMMIT: empty; must be a clone, which has a file acrc"),
        ("HEAD", "COMMIT: HEAD; must be one that has a file acrc"),
    ],
)
def test_what_is_no_state_is_told(
    what: str, sentence: str, committed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    git(committed, "rm", "-q", "acrc")
    git(committed, "commit", "-q", "-m", "none")
    with pytest.raises(OptionError) as caught, other(what):
        pass
    assert str(caught.value) == sentence
    assert nothing_is_left(committed, tmp_path)


def test_without_git_a_folder_does(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "PATH", str(tmp_path))
    with pytest.raises(AcrcError) as caught, other("HEAD"):
        pass
    assert str(caught.value) == (
        "git cannot be started: No such file or directory; a folder of a clone would do"
    )


def test_whoever_ends_the_command_ends_what_it_runs(tmp_path: Path) -> None:
    def end(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        with pytest.raises(KeyboardInterrupt):
            spent(["sh", "-c", f"sleep 60 & echo $! >{tmp_path}/pid; wait"])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    words = Path("/proc") / (tmp_path / "pid").read_text().strip() / "cmdline"
    until = time.monotonic() + 20.0
    while words.exists() and words.read_bytes() and time.monotonic() < until:  # a zombie has no words
        time.sleep(0.05)
    assert not words.exists() or not words.read_bytes()


def test_what_is_no_result_is_told(mine: Path) -> None:
    (mine / "acrc").write_text(f"#!/bin/sh\necho '{json.dumps({'digest': 'd'})}'\n")
    with pytest.raises(AcrcError) as caught:
        ProjectState("here", mine).run(PairedCase(2, 1.0, "memory"))
    assert str(caught.value) == """here: acrc run --json answers '{"digest": "d"}\\n', no result"""


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "COMMIT: is missing; must be as in acrc bench beside HEAD~1"),
        ({"commit": "HEAD", "bus": "tcp"}, "--bus: tcp; must be zenoh or memory"),
        ({"commit": "HEAD", "scenario": Path("none.toml")}, "--scenario: none.toml; must be a file"),
    ],
)
def test_what_cannot_be_compared_is_said(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(OptionError) as caught:
        command.measure(**options)  # type: ignore[arg-type]
    assert str(caught.value) == sentence
