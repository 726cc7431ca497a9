"""What bash is told at the tabulator key, and that the script which asks for it can be installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cleaning.strategies import STRATEGIES
from deploy.run.orders import VERBS
from tests import warm
from tests.cli.test_cli import ROOT


def told(words: str, cwd: Path = ROOT) -> list[str]:
    """What is offered for the last of the words, which may be empty."""
    asked = {"_ACRC_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    env = {"PYTHONPATH": str(ROOT), "PATH": "", **asked}
    done = warm.run((), cwd, env, 60.0, finds_cwd=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def test_commands_and_options() -> None:
    assert told("acrc r") == ["run", "replay", "record", "report"]
    assert told("acrc fleet st") == ["stop"]
    assert "--timeout" in told("acrc run --t")


def test_scenarios_are_the_shipped_ones_and_those_that_lie_here(tmp_path: Path) -> None:
    shipped = [f"scenarios/{name}.toml" for name in ("chapter", "corridor", "head_on")]
    assert told("acrc run sc") == shipped
    (tmp_path / "mine.toml").touch()
    offered = told("acrc run ", tmp_path)
    assert offered[0] == "mine.toml"
    assert [(tmp_path / name).resolve() for name in offered[1:]] == [ROOT / name for name in shipped]
    assert told("acrc run nothing/like/it") == [], "the shell completes files then"


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("acrc run --strategy ", list(STRATEGIES)),
        ("acrc run --strategy chapter-m", ["chapter-mute"]),
        ("acrc run --bus ", ["zenoh", "memory"]),
        ("acrc run --spawn e", ["exec"]),
        ("acrc order out ", list(VERBS)),
    ],
)
def test_values(words: str, offered: list[str]) -> None:
    assert told(words) == offered


def test_it_is_installed_for_the_shell_that_is_named(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "command_line", "--install-completion", "bash"],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path),
                       "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    script = (tmp_path / ".bash_completions" / "acrc.sh").read_text()
    assert "_ACRC_COMPLETE=complete_bash" in script and script.endswith(" acrc")
    assert str(tmp_path) in (tmp_path / ".bashrc").read_text()
