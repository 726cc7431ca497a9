"""`acrc test`: workers, a limit on started processes, skips that fail in CI, commands in forks."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from acrc_testbed.command_line import development as module
from acrc_testbed.command_line.development import BUDGET, BY_FILE, ProcessCounter, run_suite
from actors.installation.repository import REPOSITORY
from tests import warm

Suite = Callable[..., tuple[int, list[list[str]]]]
KEYS = {"bus", "deeco", "digest", "frames", "isolation", "per_robot", "undelivered", "unread"}
"""Keys of a result that depend on the run only."""


@pytest.fixture
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Suite:
    """Return exit code and pytest's arguments for a given exit code of pytest."""

    def run(*words: str, code: int = 0) -> tuple[int, list[list[str]]]:
        calls: list[list[str]] = []

        def noted(root: Path, words: list[str]) -> int:
            calls.append(list(words))
            return code

        monkeypatch.setattr("acrc_testbed.command_line.development.os.cpu_count", lambda: 1)
        monkeypatch.setattr(module, "run_pytest", noted)
        return run_suite(tmp_path, words), calls

    return run


def test_arguments_select_one_process_or_the_nightly_tests(suite: Suite) -> None:
    assert suite(code=1) == (1, [["-m", "not nightly", "-n", "2", *BY_FILE]])
    assert suite("--nightly") == (0, [["-n", "2", *BY_FILE]])
    assert suite("-q", "test_a.py", code=3) == (3, [["-q", "test_a.py"]])


def test_a_suite_that_starts_too_many_processes_fails(
    suite: Suite, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / BUDGET).parent.mkdir(parents=True)
    for limit, code in ((0, 0), (-1, 1)):
        (tmp_path / BUDGET).write_text(f"[suite]\nprocesses = {limit}\n")
        assert suite()[0] == code
    assert capsys.readouterr().err.splitlines()[-1].endswith(f"were started; {BUDGET} allows -1")
    with ProcessCounter() as started:
        subprocess.run(["sh", "-c", "sleep 0.3 & sleep 0.3; wait"], check=True)
    assert started.count == 3


def test_a_skipped_module_is_a_failure_under_ci(tmp_path: Path) -> None:
    """Skip a module in a worker of pytest-xdist; the controller reports it."""
    (tmp_path / "test_gone.py").write_text("import pytest\npytest.skip('why', allow_module_level=True)\n")
    (tmp_path / "test_here.py").write_text("def test_passes(): pass\n")
    words = ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", ".", "-n", "1", "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "CI": "true", "PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip
    assert done.returncode == 1, done.stdout
    sentence = "CI is set, so skipped tests are failures; skipped: test_gone.py"
    assert sentence in done.stdout.splitlines()


def forked(words: tuple[str, ...], cwd: Path, **env: str) -> tuple[int, str, str]:
    done = warm.run(words, cwd, {**os.environ, **env}, 60.0, finds_cwd=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.nightly
def test_a_fork_runs_over_the_mesh_like_a_new_interpreter(tmp_path: Path) -> None:
    words = ("run", "--duration", "1", "--robots", "2", "--json", "--out")
    command = [sys.executable, "-m", "acrc_testbed.command_line", *words, "new"]
    new = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    code, answer, errors = forked((*words, "forked"), tmp_path)
    assert (new.returncode, new.stderr) == (code, errors) == (0, "")
    first, second = ({key: json.loads(text)[key] for key in KEYS} for text in (new.stdout, answer))
    assert first == second


def test_a_fork_has_its_own_folder_environment_and_end(tmp_path: Path) -> None:
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "further.py").write_text("raise RuntimeError('found on the path')\n")
    words = ("run", "--strategy", "further:behaviour", "--out", str(tmp_path / "out"))
    assert "found on the path" in forked(words, tmp_path, PYTHONPATH=str(tmp_path / "path"))[2]
    assert "there is no module 'further'" in forked(words, tmp_path)[2]
    endless = ("run", "--bus", "memory", "--duration", "100000", "--out", str(tmp_path / "out"))
    with pytest.raises(subprocess.TimeoutExpired):
        warm.run(endless, tmp_path, os.environ, 0.5, finds_cwd=True)
    begun = warm.begin((*endless, "2"), tmp_path, os.environ, finds_cwd=True)
    assert begun.poll() is None
    begun.kill()
    assert begun.communicate(20)[0] == "" and begun.wait() == begun.poll() == -signal.SIGKILL
