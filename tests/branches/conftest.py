"""One short run that all branches leave."""

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from actors.robot.behaviour.foreign import INSTALLED
from deploy.branches.branching import Branched, branch
from deploy.branches.change import Change
from deploy.run.options import RunOptions
from tests.recorded_runs import record

Leave = Callable[[Change], Branched]


@pytest.fixture(scope="session")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots that meet, with the chapter's adaptation, for 12 s, in memory."""
    out = tmp_path_factory.mktemp("origin") / "run"
    record(out, duration=12.0)
    return out


@pytest.fixture
def leave(origin: Path, tmp_path: Path) -> Leave:
    """Carries out a branch of it."""
    number = count()

    def carry_out(change: Change) -> Branched:
        out = tmp_path / f"branch-{next(number)}"
        return branch(origin, change, RunOptions(out, bus="memory"), permit=INSTALLED)

    return carry_out
