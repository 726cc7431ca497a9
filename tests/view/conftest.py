"""One run in a doorway; tests that need rerun are skipped if it is not installed."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated_runs import read_run
from tests.recorded_runs import record

DRAWN = ("drawn", "live", "run_drawing")
collect_ignore = [] if find_spec("rerun") else [f"test_{name}.py" for name in DRAWN]


Rows = dict[str, list[dict[str, Any]]]


def rows(path: Path) -> Rows:
    """Return everything in a view file, by entity and time; static rows have no sim_time."""
    reader = pytest.importorskip("rerun.chunk").RrdReader
    found: Rows = {}
    for chunk in reader(str(path)).stream():
        found.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pylist())
    for some in found.values():
        some.sort(key=lambda row: row["sim_time"].total_seconds() if "sim_time" in row else -1.0)
    return found


@pytest.fixture(scope="session")
def folder(recorded_run: Path) -> Path:
    return recorded_run


@pytest.fixture(scope="module")
def strict() -> Iterator[None]:
    """Make rerun raise instead of warn."""
    rr = pytest.importorskip("rerun")
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunData:
    """Return the run with introspection."""
    return read_run(folder, internals=True)


@pytest.fixture(scope="session")
def lean(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run recorded with --record lean."""
    out = tmp_path_factory.mktemp("lean") / "run"
    record(out, detail="lean", duration=10.0)
    return out
