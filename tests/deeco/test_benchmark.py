"""That the benchmark of the component model runs and measures what it says; never how fast anything is."""

import json

import pytest

from benchmarks.foundations import deeco


def test_figures_beside_their_goals(capsys: pytest.CaptureFixture[str]) -> None:
    task = deeco.DeecoTask(
        replicas=3, evaluations=2, activations=50, senders=3, publications=3, minutes=0.1, repeats=1
    )
    figures = deeco.run(task=task)
    printed = capsys.readouterr().out
    assert all(
        goal in printed
        for goal in ("at least 200,000", "at most 20 µs", "at most 15 µs", "at most 3 µs", "at most 0.6 ms")
    )
    assert figures["memberships_per_cpu_s"] > 0 and figures["robot_second_cpu_ms"] > 0
    assert figures["fresh_packet_cpu_us"] > 0
    deeco.run(json_output=True, task=task)
    assert json.loads(capsys.readouterr().out)["task"]["peers"] == 4
