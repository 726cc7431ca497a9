"""One run in a doorway, traced once; tests that need rerun are left out where it is not installed."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated import read_run
from acrc_testbed.trace.rows import Trace
from acrc_testbed.trace.traces import Traced, traces
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.isolation import sandbox

DRAWN = ("drawn", "live", "painting")
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
    """Let rerun raise where it would only warn."""
    rr = pytest.importorskip("rerun")
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunData:
    return read_run(folder)


@pytest.fixture(scope="session")
def traced(folder: Path, evidence: RunData) -> list[Traced]:
    """World and robots, each in a sandbox where the machine has one."""
    isolate = sandbox.available() is None
    return list(traces(folder, ["world", *evidence.robots], permit=INSTALLED, isolate=isolate))


@pytest.fixture(scope="session")
def insides(traced: list[Traced]) -> dict[str, Trace]:
    """The trace of each robot."""
    found = {one.actor: one.whole() for one in traced if one.parts}
    assert sorted(found) == ["r1", "r2"], traced
    return found
