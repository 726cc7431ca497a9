"""A forked command does what a command in a new interpreter does."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from actors.processes.launch import launcher
from tests import warm

TOLD = {"bus", "deeco", "digest", "frames", "isolation", "per_robot", "undelivered", "unread"}
"""What a result says of the run."""


def new(words: tuple[str, ...], cwd: Path, env: dict[str, str]) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "command_line", *words],
        cwd=cwd, env=env, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def forked(words: tuple[str, ...], cwd: Path, env: dict[str, str]) -> tuple[int, str, str]:
    done = warm.run(words, cwd, env, 60.0, finds_cwd=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("list", "strategies"),
        ("rum",),
        ("run", "--strategy", "beside:behaviour", "--out", "out"),
    ],
    ids=" ".join,
)
def test_it_has_exit_code_folder_environment_and_streams_of_its_own(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "beside.py").write_text("import further\n")
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "further.py").write_text("raise RuntimeError('found on the path')\n")
    path = os.pathsep.join((str(warm.ROOT), str(tmp_path / "path")))
    env = {**os.environ, "PYTHONPATH": path, "COLUMNS": "60"}
    assert forked(words, tmp_path, env) == new(words, tmp_path, env)


def test_a_run_over_the_mesh_is_the_one_that_a_new_interpreter_makes(tmp_path: Path) -> None:
    words = ("run", "--duration", "1", "--robots", "2", "--json", "--out")
    told = []
    for way in (new, forked):
        code, answer, said = way((*words, str(tmp_path / way.__name__)), tmp_path, dict(os.environ))
        assert (code, said) == (0, "")
        told.append({key: value for key, value in json.loads(answer).items() if key in TOLD})
    assert told[0] == told[1] and told[0].keys() == TOLD


def test_what_is_set_for_one_command_is_not_there_for_the_next(tmp_path: Path) -> None:
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "further.py").write_text("raise RuntimeError('found on the path')\n")
    words = ("run", "--strategy", "further:behaviour", "--out", str(tmp_path / "out"))
    there = forked(words, tmp_path, {**os.environ, "PYTHONPATH": str(tmp_path / "path")})
    gone = forked(words, tmp_path, dict(os.environ))
    assert "found on the path" in there[2] and "there is no module 'further'" in gone[2]


def test_it_may_be_held_to_some_cores(tmp_path: Path) -> None:
    (tmp_path / "told.py").write_text("import os\ndef main(): print(os.sched_getaffinity(0))\n")
    for cores, there in (((), os.sched_getaffinity(0)), ((0,), {0}), ((), os.sched_getaffinity(0))):
        done = warm.run((), tmp_path, os.environ, 60.0, finds_cwd=True, program="told", cores=cores)
        assert done.stdout == f"{there}\n"


def test_what_an_interpreter_reads_at_its_beginning_needs_a_new_one() -> None:
    assert warm.heeds(dict(os.environ)) and warm.heeds({"COLUMNS": "60", "PYTHONPATH": "/nowhere"})
    for name in ("NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES", "NUMBA_DISABLE_JIT", "PYTHONHASHSEED"):
        assert not warm.heeds({**os.environ, name: "7"})


def test_what_is_begun_goes_on_beside_others_until_it_is_ended(tmp_path: Path) -> None:
    words = ["run", "--bus", "memory", "--duration", "100000", "--out", str(tmp_path / "out")]
    begun = warm.begin(words, tmp_path, os.environ, finds_cwd=True)
    assert forked(("--version",), tmp_path, dict(os.environ))[0] == 0
    assert begun.poll() is None and os.getpgid(begun.pid) > 0
    with pytest.raises(subprocess.TimeoutExpired):
        begun.wait(0.1)
    begun.kill()
    assert begun.communicate(20)[0] == "" and begun.wait() == begun.poll() == -signal.SIGKILL


@pytest.mark.usefixtures("forked_servers")
@pytest.mark.parametrize(("spawn", "kind"), [("forkserver", warm.ForkedServer), ("exec", subprocess.Popen)])
def test_a_server_that_forks_is_a_fork_and_ends_with_its_launcher(spawn: str, kind: type) -> None:
    with launcher(spawn) as launched:
        server = launched._server
        assert isinstance(server, kind)
        while not launched._ready:  # before that it is killed: nobody wants what it imports
            launched._hear()
    assert server.wait() == 0


def test_a_command_that_takes_too_long_is_killed(tmp_path: Path) -> None:
    words = ("run", "--bus", "memory", "--duration", "100000", "--out", str(tmp_path / "out"))
    with pytest.raises(subprocess.TimeoutExpired):
        warm.run(words, tmp_path, os.environ, 0.5, finds_cwd=True)
    assert forked(("--version",), tmp_path, dict(os.environ))[0] == 0
