"""`acrc run --debug`: a breakpoint in one robot's strategy pauses the world and loses nothing."""

import json
import os
import pty
import select
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.swarm.command import ACRC, ROOT, acrc, leftovers, processes_of

SCENARIO: Final = REPOSITORY / "scenarios" / "head_on.toml"
WORDS: Final = ("run", SCENARIO, "--strategy", "tests.debugging.stopping:behaviour", "--duration", 3)


class Terminal:
    """A run of `acrc …` with its own terminal and typed input."""

    def __init__(self, *words: object) -> None:
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [*ACRC, *map(str, words)], stdin=theirs, stdout=theirs, stderr=theirs, cwd=ROOT
        )
        os.close(theirs)
        self.shown = ""

    def _read(self) -> bool:
        """Read new output; return False if the other end is closed."""
        try:
            if select.select([self._ours], [], [], 0.2)[0]:
                self.shown += os.read(self._ours, 4096).decode(errors="replace")
        except OSError:
            return False
        return True

    def until(self, text: str) -> None:
        deadline = time.monotonic() + 60.0
        while text not in self.shown:
            assert self._read() and time.monotonic() < deadline, self.shown

    def type(self, line: str) -> None:
        self.shown = ""
        os.write(self._ours, f"{line}\n".encode())

    def end(self) -> int:
        while self._read() or self.process.poll() is None:
            pass
        return self.process.wait(30)

    def close(self) -> None:
        self.process.kill()
        os.close(self._ours)


@pytest.fixture
def terminals() -> Iterator[list[Terminal]]:
    opened: list[Terminal] = []
    yield opened
    for one in opened:
        one.close()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of the run without a breakpoint."""
    options = RunOptions(tmp_path_factory.mktemp("undisturbed") / "out", bus="memory")
    settled = load_scenario(SCENARIO, Overrides(duration=3.0, strategy="none"))
    return swarm.run_in_memory(swarm.plan(settled, options), lambda progress: None).digest


@pytest.mark.parametrize("bus", ["memory", pytest.param("zenoh", marks=pytest.mark.nightly)])
def test_a_breakpoint_stops_the_world(
    bus: str, undisturbed: str, tmp_path: Path, terminals: list[Terminal]
) -> None:
    out = tmp_path / "out"
    terminal = Terminal(*WORDS, "--debug", "r2", "--bus", bus, "--timeout", 2, "--out", out)
    terminals.append(terminal)
    terminal.until("(Pdb) ")
    assert "stopping.py" in terminal.shown
    terminal.type("p self.id, now")
    terminal.until("('r2', 1000000)")
    stands = _size(out)
    time.sleep(2.7)  # the time-out is over, and was looked at
    assert (terminal.process.poll(), _size(out)) == (None, stands)
    terminal.type("c")
    assert terminal.end() == 0, terminal.shown
    assert processes_of(out) == [] and leftovers(out) == []
    assert _result(out)["digest"] == undisturbed
    if bus == "zenoh":
        assert _result(out)["isolation"] == "credentials"


@pytest.mark.nightly
def test_quitting_the_debugger_ends_the_run_with_a_message(tmp_path: Path, terminals: list[Terminal]) -> None:
    terminal = Terminal(*WORDS, "--debug", "r2", "--bus", "memory", "--out", tmp_path / "out")
    terminals.append(terminal)
    terminal.until("(Pdb) ")
    terminal.type("q")
    assert terminal.end() == 1
    assert "the run ended because the debugger was quit; use `c` to continue" in terminal.shown.replace(
        "\r\n", " "
    )


def test_invalid_debug_options(tmp_path: Path) -> None:
    done = acrc(*WORDS, "--debug", "r2", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "--debug: r2; standard input must be a terminal" in done.stderr
    with pytest.raises(OptionError, match="--debug: r9; must be one of r1, r2"):
        swarm.plan(load_scenario(SCENARIO), RunOptions(tmp_path / "out", bus="memory", debug="r9"))


@pytest.mark.nightly
def test_breakpoint_without_a_terminal_names_the_option(tmp_path: Path) -> None:
    done = acrc(*WORDS, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "breakpoint() has no terminal; use `acrc run --debug r" in done.stderr


def _size(out: Path) -> int:
    return (out / "world" / "world.mcap").stat().st_size


def _result(out: Path) -> dict[str, str]:
    told: dict[str, str] = json.loads((out / "run.json").read_text())
    return told
