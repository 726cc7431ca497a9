"""Simulated runs whose recordings are collected."""

from pathlib import Path
from typing import NamedTuple

import pytest

from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY
from tests.field_trial.runs import CROWD, clock, copies, run


class Run(NamedTuple):
    out: Path
    result: RunResult


@pytest.fixture(scope="session")
def head_on(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Two robots that visit all their places."""
    out = tmp_path_factory.mktemp("head_on") / "out"
    return Run(out, run(REPOSITORY / "scenarios" / "head_on.toml", out, 300.0))


@pytest.fixture(scope="session")
def crowd(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Four robots; one is killed after 10 s, another one restarted after 30 s of 60 s."""
    folder = tmp_path_factory.mktemp("crowd")
    (folder / "crowd.toml").write_text(CROWD)
    return Run(folder / "out", run(folder / "crowd.toml", folder / "out", 60.0))


@pytest.fixture
def far(head_on: Run, tmp_path: Path) -> Path:
    """Copy the recordings of both robots of `head_on`."""
    return copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock()})
