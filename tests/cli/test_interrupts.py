"""Ctrl-C at any moment of a command: one sentence, exit code 130, nothing left behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from actors.processes.signals import Interrupted, signals_as_interrupts
from tests.swarm.command import ROOT

INTERRUPTED = """
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
left = int(sys.argv[1])
def count(event, arguments):
    global left
    left -= event in {"import", "open", "exec"}
    if left == 0:
        left = -1
        os.kill(os.getpid(), signal.SIGINT)
sys.argv = ["acrc", *sys.argv[2:]]
import command_line
sys.addaudithook(count)
runpy.run_module("command_line", run_name="__main__", alter_sys=True)
"""
"""The command line in a process that interrupts itself at its so manyth import, file or piece of code."""


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (20, "list strategies"),
        pytest.param(250, "list strategies", marks=pytest.mark.nightly),
        pytest.param(400, "run --bus memory --duration 1 --out OUT", marks=pytest.mark.nightly),
        (2500, "run --bus memory --duration 1 --out OUT"),
        pytest.param(1200, "demo --out OUT", marks=pytest.mark.nightly),
        (1500, "campaign --preset chapter --out OUT"),
    ],
)
def test_ctrl_c_at_any_moment_is_one_sentence(tmp_path: Path, event: int, words: str) -> None:
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-P", "-c", INTERRUPTED, str(event), *words.replace("OUT", str(out)).split()],
        cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert done.returncode == 130
    kept = f"; what was recorded is in {out}" if out.exists() else ""
    if words.startswith("campaign") and out.exists():
        kept = f"; the same command resumes from {out}"
    assert done.stderr.splitlines()[-1:] == [f"acrc: ended from outside{kept}"]
    assert "Traceback" not in done.stderr


def test_ctrl_c_while_a_package_written_in_c_is_imported() -> None:
    with pytest.raises(Interrupted), signals_as_interrupts():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except Interrupted:
            raise ImportError("numpy._core.multiarray failed to import") from None
