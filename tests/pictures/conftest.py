"""One run of the meeting in the doorway, and what its recordings show."""

from pathlib import Path

import pytest

from observation.evidence.run_evidence import RunEvidence
from observation.evidence.run_reader import read_run
from tests.swarm.command import ROOT, run


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("pictures") / "run"
    run(out, ROOT / "scenarios" / "head_on.toml", "--bus", "memory")
    return out


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunEvidence:
    return read_run(folder)
