"""A command in a fork of the preloaded process does what one in a new interpreter does."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests import warm

KEYS = {"bus", "deeco", "digest", "frames", "isolation", "per_robot", "undelivered", "unread"}
"""What a result reports of the run."""


def new(words: tuple[str, ...], cwd: Path) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "command_line", *words], cwd=cwd, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout, done.stderr


def forked(words: tuple[str, ...], cwd: Path, **env: str) -> tuple[int, str, str]:
    done = warm.run(words, cwd, {**os.environ, **env}, 60.0, finds_cwd=True)
    return done.returncode, done.stdout, done.stderr


def test_a_run_over_the_mesh_equals_that_of_a_new_interpreter(tmp_path: Path) -> None:
    words = ("run", "--duration", "1", "--robots", "2", "--json", "--out")
    results = []
    for way in (new, forked):
        code, answer, errors = way((*words, str(tmp_path / way.__name__)), tmp_path)
        assert (code, errors) == (0, "")
        results.append({key: value for key, value in json.loads(answer).items() if key in KEYS})
    assert results[0] == results[1] and results[0].keys() == KEYS


def test_folder_and_environment_are_those_of_one_command(tmp_path: Path) -> None:
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "further.py").write_text("raise RuntimeError('found on the path')\n")
    words = ("run", "--strategy", "further:behaviour", "--out", str(tmp_path / "out"))
    assert "found on the path" in forked(words, tmp_path, PYTHONPATH=str(tmp_path / "path"))[2]
    assert "there is no module 'further'" in forked(words, tmp_path)[2]
    assert forked(("rum",), tmp_path) == (2, "", "acrc: rum: is no command of acrc; did you mean run?\n")


def test_a_command_runs_until_it_is_killed(tmp_path: Path) -> None:
    words = ("run", "--bus", "memory", "--duration", "100000", "--out", str(tmp_path / "out"))
    with pytest.raises(subprocess.TimeoutExpired):
        warm.run(words, tmp_path, os.environ, 0.5, finds_cwd=True)
    begun = warm.begin((*words, "2"), tmp_path, os.environ, finds_cwd=True)
    assert begun.poll() is None
    begun.kill()
    assert begun.communicate(20)[0] == "" and begun.wait() == begun.poll() == -signal.SIGKILL
