"""That the benchmark of the component model runs and measures what it says; never how fast anything is."""

from rich.table import Table

from benchmarks.foundations import deeco


def test_figures_beside_their_goals() -> None:
    task = deeco.DeecoTask(
        replicas=3, evaluations=2, activations=50, senders=3, publications=3, minutes=0.1, repeats=1
    )
    found = deeco.measure(task)
    figures = found.figures
    (table,) = found.shown
    assert isinstance(table, Table)
    assert list(table.columns[2].cells) == [
        "at least 200,000", "at most 20 µs", "at most 15 µs", "at most 3 µs", "at most 0.6 ms",
    ]  # fmt: skip
    assert figures["memberships_per_cpu_s"] > 0 and figures["robot_second_cpu_ms"] > 0
    assert figures["fresh_packet_cpu_us"] > 0
    assert figures["task"]["peers"] == 4
