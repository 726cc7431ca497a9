"""What bash is told at the tabulator key, and that the script which asks for it can be installed."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY as ROOT
from cleaning.strategies import STRATEGIES
from deploy.run.orders import VERBS
from tests.in_process import acrc


def told(words: str, cwd: Path = ROOT) -> list[str]:
    """What is offered for the last of the words, which may be empty."""
    asked = {"_ACRC_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = acrc(cwd=cwd, env=asked)
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
    env = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = acrc("--install-completion", "bash", env=env)
    assert (done.returncode, done.stderr) == (0, "")
    script = (tmp_path / ".bash_completions" / "acrc.sh").read_text()
    assert "_ACRC_COMPLETE=complete_bash" in script and script.endswith(" acrc")
    assert str(tmp_path) in (tmp_path / ".bashrc").read_text()
