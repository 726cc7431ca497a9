"""A short run in which the causes of decisions are planted, and the complete run in a doorway."""

from pathlib import Path

import pytest

from tests.recorded_runs import record

PLANTED = """
map = "../maps/corridor.yaml"

[run]
duration = 16.0
seed = 1
strategy = "tests.explanation.planted:behaviour"

[deeco]
relay = true

[robots]
count = 4
start = [[6.5, 12.5, 0.0], [13.0, 12.5, 0.0], [20.0, 12.5, 0.0], [12.0, 11.5, 0.0]]

[localisation]
preset = "odometry"

[navigation]
preset = "robust"

[places]
preset = "golden"
per_robot = 1

[[event]]
at = 4.9
jam = [13.0, 12.5]
radius = 3.0
duration = 3.0
"""
"""r2 and r4 hear nothing from 4.9 s to 7.9 s; r3 is too far from r1 to hear it."""


@pytest.fixture(scope="session")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("planted") / "out"
    record(out, PLANTED)
    return out


@pytest.fixture(scope="session")
def doorway(complete_run: Path) -> Path:
    return complete_run
