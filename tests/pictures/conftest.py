"""One run of the meeting in the doorway, and its data."""

from pathlib import Path

import pytest

from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated_runs import read_run


@pytest.fixture(scope="session")
def folder(complete_run: Path) -> Path:
    return complete_run


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunData:
    return read_run(folder)
