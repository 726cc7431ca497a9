"""Standard streams that are closed, full, or read by nobody, and signals that are to be ignored."""

import ctypes
import os
import signal
import subprocess
import sys
import time

import pytest

from actors.processes.signals import Interrupted, signals_as_interrupts
from tests.swarm.command import ACRC, ROOT

LIST = " ".join((*ACRC, "list", "strategies"))


def shell(command: str) -> tuple[int, str, str]:
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("where", ["<&- >&- 2>&-", "2>/dev/full", "| true"])
def test_nobody_who_listens_is_no_fault(where: str) -> None:
    code, _, err = shell(f"set -o pipefail; {LIST} {where}")
    assert (code, err) == (0, "")


def test_standard_output_that_is_full_is_a_sentence() -> None:
    assert shell(f"{LIST} >/dev/full") == (
        1,
        "",
        "acrc: standard output cannot be written: no space left on device\n",
    )


def test_a_file_that_is_opened_never_becomes_standard_output() -> None:
    program = (
        "import os; from command_line.streams import settle; settle(); "
        "os._exit(0 if os.open('/dev/null', os.O_RDONLY) > 2 else 9)"
    )
    assert shell(f'{sys.executable} -c "{program}" <&- >&- 2>&-')[0] == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP, signal.SIGTERM])
def test_a_signal_ends_a_run_unless_it_was_to_be_ignored_as_under_nohup(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with signals_as_interrupts():
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.SIG_IGN
        signal.signal(number, signal.SIG_DFL)
        with pytest.raises(Interrupted) as caught, signals_as_interrupts():
            os.kill(os.getpid(), number)
        assert caught.value.exit_code == 128 + number
    finally:
        signal.signal(number, before)


def test_a_signal_that_comes_while_a_class_is_made_is_one_all_the_same() -> None:
    class Interrupting:
        def __set_name__(self, owner: type, name: str) -> None:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interrupted) as caught, signals_as_interrupts():
        type("Made", (), {"attribute": Interrupting()})
    assert caught.value.exit_code == 128 + signal.SIGTERM


def test_a_signal_that_comes_while_c_calls_python_is_not_lost() -> None:
    calls: list[int] = []

    def call() -> None:
        calls.append(0)
        os.kill(os.getpid(), signal.SIGTERM)

    called = ctypes.CFUNCTYPE(None)(call)
    before = sys.unraisablehook
    with pytest.raises(Interrupted) as caught, signals_as_interrupts():
        called()
        called()
        time.sleep(10.0)
    assert caught.value.exit_code == 128 + signal.SIGTERM
    assert (len(calls), sys.unraisablehook) == (2, before)


def test_a_signal_that_was_lost_comes_by_the_end_of_what_it_was_to_end_and_not_later() -> None:
    called = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM))
    late: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: late.append(number))
    try:
        for _ in range(3):
            with pytest.raises(Interrupted) as caught, signals_as_interrupts():
                called()
            assert caught.value.exit_code == 128 + signal.SIGTERM
        time.sleep(0.3)  # six times as long as one that is lost takes to come again
    finally:
        signal.signal(signal.SIGTERM, before)
    assert late == []


def test_python_that_closes_standard_output_before_what_stands_there_ends_without_a_word() -> None:
    program = (
        "import sys; from actors.runtime.prints import taken_by\n"
        "with taken_by(None): pass\n"
        "sys.stdout.close(); sys.stderr.flush()"
    )
    done = subprocess.run(
        [sys.executable, "-X", "dev", "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
