"""Added places and closed doors during a run of two robots, in memory."""

from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import recheck
from acrc_testbed.run_model.simulated_runs import read_run
from tests.recorded_runs import record

SCENARIO = """
map = "../maps/corridor.yaml"
[run]
duration = 120.0
[localisation]
preset = "odometry"
[navigation]
preset = "robust"
[places]
preset = "listed"
[robots]
count = 2
odometry = "exact"
[[robot]]
id = "r1" # in an office, and done at once
start = [12.4, 5.0, 1.57]
places = [[12.4, 5.3]]
[[robot]]
id = "r2"
start = [20.0, 12.0, 0.0]
places = [[20.3, 12.0]]
[[event]]
at = 1.0
close = [12.5, 9.5] # the office's door
[[event]]
at = 10.0
give = "r1"
places = [[12.5, 7.5], [12.5, 12.5]] # inside, and outside
[[event]]
at = 40.0
open = [12.5, 9.5]
"""
OPENED_S = 40.0


@pytest.mark.parametrize("strategy", ["none", "auction"])
def test_an_added_place_is_visited_once_the_door_is_open(strategy: str, tmp_path: Path) -> None:
    result = record(tmp_path / "run", SCENARIO, strategy=strategy)
    places = {(item["owner"], item["place"]): item for item in read_run(tmp_path / "run").items}
    inside, outside = places["r1", 1], places["r1", 2]
    assert (inside["given_s"], outside["given_s"]) == (10.0, 10.0)
    assert result.task["places_done"] == result.task["places_total"] == 4
    reached = inside["reached_s"], outside["reached_s"]
    assert isinstance(reached[0], float) and isinstance(reached[1], float)
    assert 10.0 < reached[0] < OPENED_S or strategy == "auction"
    assert outside["reached_by"] != "r1" or reached[1] > OPENED_S
    ways = [part.driven_m or 0.0 for part in result.per_robot.values()]
    assert result.driven_m == pytest.approx(sum(ways)) and 7.0 < sum(ways) < 60.0
    if strategy == "none":
        again = recheck(tmp_path / "run")
        assert again.actors == 4, "world, radio and both robots send the same bytes again"
