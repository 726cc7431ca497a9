"""A strategy is checked by `mypy --strict` in any folder: the packages are found, and they are typed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from actors.installation.repository import PACKAGES, REPOSITORY

MISTAKEN = """
from actors.robot.behaviour import Behaviour, Start, host
from cleaning import CleaningRobot, assignments
from deeco import seconds

PERIOD: str = seconds(0.5)


def behaviour(start: Start) -> Behaviour:
    robot = CleaningRobot(id=start.address, position=start.pose.point, route=assignments(start))
    return host(start, robot)
"""


def mypy(folder: Path, *files: str) -> list[str]:
    """What it says in a folder that has no settings, of files there."""
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--no-pretty", *files]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # leads to the clone
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.nightly
def test_a_strategy_is_checked_wherever_it_lies(tmp_path: Path) -> None:
    shutil.copy(REPOSITORY / "examples" / "courteous.py", tmp_path / "mine.py")
    (tmp_path / "mistaken.py").write_text(MISTAKEN)
    first, second, last = mypy(tmp_path, "mine.py", "mistaken.py")
    assert first == (
        'mistaken.py:6: error: Incompatible types in assignment (expression has type "Duration", '
        'variable has type "str")  [assignment]'
    )
    assert second == (
        'mistaken.py:10: error: Argument "id" to "CleaningRobot" has incompatible type "int"; '
        'expected "str"  [arg-type]'
    )
    assert last == "Found 2 errors in 1 file (checked 2 source files)"


def test_every_package_says_that_it_is_typed() -> None:
    assert {path.parent.name for path in REPOSITORY.glob("*/py.typed")} == PACKAGES
