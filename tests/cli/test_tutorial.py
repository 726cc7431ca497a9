"""docs/tutorial.md: its files and commands work and give the described results."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests import warm

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "tutorial.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def said() -> Iterator[dict[str, str]]:
    with TemporaryDirectory(prefix="acrc-") as folder:  # a short path, as those of sockets are limited
        yield printed_by_commands(Path(folder))


def printed_by_commands(folder: Path) -> dict[str, str]:
    for name in ("scenarios", "maps"):
        (folder / name).symlink_to(ROOT / name)
    for block in blocks("python"):
        comment, _, text = block.partition("\n")
        path = folder / comment.removeprefix("# ")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return {command.strip(): typed(folder, command) for command in blocks("sh")}


def typed(folder: Path, command: str) -> str:
    program, *words = shlex.split(command)
    assert program == "./acrc"
    env = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    if words[0] == "test":  # it runs pytest in the clone, for which the folder stands here
        pytest_words = [sys.executable, "-m", "pytest", *words[1:]]
        done = subprocess.run(pytest_words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    else:
        done = warm.run(words, folder, env, 200.0, finds_cwd=False)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_the_tutorial_gives_the_described_results(said: dict[str, str]) -> None:
    without, tested, mine, measured = said.values()
    assert "0 of 6" in without
    assert "2 passed" in tested
    assert "6 of 6" in mine
    lines = [line for line in measured.splitlines() if " places done, done or given up in " in line]
    summary = {line.partition(": ")[0]: line for line in lines}
    assert list(summary) == ["none", "chapter", "my_study.yielding:behaviour"]
    assert ", done in 0 of 3 runs" in summary["none"]
    settled = [
        float(re.findall(r"half of the runs by ([\d.]+) s", line)[0]) for line in list(summary.values())[1:]
    ]
    assert ", done in 3 of 3 runs" in summary["chapter"]
    assert ", done in 3 of 3 runs" in summary["my_study.yielding:behaviour"]
    assert "3 of 9 runs were repeated as processes (" in measured
    assert "): 3 with the same result; speed in memory " in measured
    assert settled[1] < min(90.0, settled[0]), "in a minute and a half, sooner than the chapter's exchange"
