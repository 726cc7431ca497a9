"""What `acrc bench recordings` finds: a run that is recorded, of which one robot is replayed."""

import pytest

from benchmarks.recordings import recordings
from benchmarks.recordings.recordings import RecordingFigures


def test_a_swarm_is_recorded_and_one_robot_executed_again() -> None:
    (row,) = recordings.measure((2,), 5.0).figures
    *_, share, size, lost, replayed, speed = row.values()
    assert [*row][:3] == ["robots", "simulated s", "CPU s"]
    assert 0.01 < float(share.rstrip("%")) / 100 < 0.5
    assert 0.5 < float(size) < 20.0
    assert lost == 0
    assert replayed.startswith("r1: identical, ")
    assert float(speed) > 1.0


@pytest.mark.parametrize(
    "missed", [{"share": 0.16}, {"mb_per_minute": 20.1}, {"lost": 1}, {"replay_speed": 199.0}]
)
def test_every_goal_counts(missed: dict[str, float]) -> None:
    reached = {"share": 0.1, "mb_per_minute": 19.0, "lost": 0, "replay_speed": 250.0}
    alike = {"robots": 20, "simulated_s": 60.0, "run_cpu_s": 30.0, "replayed": "r1", "outputs": 900}
    assert RecordingFigures(**alike | reached).reached  # type: ignore[arg-type]
    assert not RecordingFigures(**alike | reached | missed).reached  # type: ignore[arg-type]
