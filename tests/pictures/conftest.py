"""One run of the meeting in the doorway, and what its recordings show."""

from pathlib import Path

import pytest

from acrc_testbed.evidence.run_evidence import RunEvidence
from acrc_testbed.evidence.run_reader import read_run


@pytest.fixture(scope="session")
def folder(complete_run: Path) -> Path:
    return complete_run


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunEvidence:
    return read_run(folder)
