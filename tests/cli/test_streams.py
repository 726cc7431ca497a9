"""Signals at any moment, and standard streams that are closed or full."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from actors.processes.signals import Interruption, signals_as_interrupts
from tests.swarm.command import ACRC, ROOT

LIST = " ".join((*ACRC, "list", "strategies"))
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
import acrc_testbed.command_line
sys.addaudithook(count)
runpy.run_module("acrc_testbed.command_line", run_name="__main__", alter_sys=True)
"""
"""Run the command line and send SIGINT at the nth import, opened file or executed code."""


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (20, "list strategies"),
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
    kept = f"; recordings are in {out}" if out.exists() else ""
    if words.startswith("campaign") and out.exists():
        kept = f"; the same command resumes from {out}"
    assert done.stderr.splitlines()[-1:] == [f"acrc: interrupted{kept}"]
    assert "Traceback" not in done.stderr


def test_ctrl_c_while_a_package_written_in_c_is_imported() -> None:
    with pytest.raises(Interruption), signals_as_interrupts():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except Interruption:
            raise ImportError("numpy._core.multiarray failed to import") from None


def shell(command: str) -> tuple[int, str, str]:
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("where", "sentence"),
    [
        ("<&- >&- 2>&-", ""),
        ("2>/dev/full", ""),
        ("| true", ""),
        (">/dev/full", "acrc: standard output cannot be written: no space left on device\n"),
    ],
)
def test_closed_streams_are_no_error_and_a_full_one_is_a_sentence(where: str, sentence: str) -> None:
    code, _, err = shell(f"set -o pipefail; {LIST} {where}")
    assert (code, err) == (int(bool(sentence)), sentence)


def test_a_file_that_is_opened_never_becomes_standard_output() -> None:
    program = (
        "import os; from acrc_testbed.command_line.app import protect_standard_streams as p; p(); "
        "os._exit(0 if os.open('/dev/null', os.O_RDONLY) > 2 else 9)"
    )
    assert shell(f'{sys.executable} -c "{program}" <&- >&- 2>&-')[0] == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP, signal.SIGTERM])
def test_a_signal_ends_a_run_unless_it_is_ignored_as_under_nohup(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with signals_as_interrupts():
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.SIG_IGN
        signal.signal(number, signal.SIG_DFL)
        with pytest.raises(Interruption) as caught, signals_as_interrupts():
            os.kill(os.getpid(), number)
        assert caught.value.exit_code == 128 + number
    finally:
        signal.signal(number, before)


def test_a_signal_during_class_creation_is_not_lost() -> None:
    class Interrupting:
        def __set_name__(self, owner: type, name: str) -> None:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interruption) as caught, signals_as_interrupts():
        type("Made", (), {"attribute": Interrupting()})
    assert caught.value.exit_code == 128 + signal.SIGTERM


def test_a_signal_during_a_callback_from_c_is_not_lost() -> None:
    calls: list[int] = []

    def call() -> None:
        calls.append(0)
        os.kill(os.getpid(), signal.SIGTERM)

    called = ctypes.CFUNCTYPE(None)(call)
    before = sys.unraisablehook
    with pytest.raises(Interruption) as caught, signals_as_interrupts():
        called()
        called()
        time.sleep(10.0)
    assert caught.value.exit_code == 128 + signal.SIGTERM
    assert (len(calls), sys.unraisablehook) == (2, before)


def test_a_lost_signal_is_repeated_before_the_end_of_the_block_and_not_later() -> None:
    called = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM))
    late: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: late.append(number))
    try:
        for _ in range(3):
            with pytest.raises(Interruption) as caught, signals_as_interrupts():
                called()
            assert caught.value.exit_code == 128 + signal.SIGTERM
        time.sleep(0.3)  # six times the delay of a repetition
    finally:
        signal.signal(signal.SIGTERM, before)
    assert late == []
