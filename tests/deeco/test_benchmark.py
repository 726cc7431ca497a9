"""That the benchmark of the component model runs and measures what it says; never how fast anything is."""

from benchmarks.foundations import deeco


def test_figures_beside_their_goals() -> None:
    task = deeco.DeecoTask(
        replicas=3, evaluations=2, activations=50, senders=3, publications=3, minutes=0.1, repeats=1
    )
    found = deeco.measure(task)
    figures = found.figures
    goals = [str(one).partition(":")[0] for one in found.shown]
    assert goals == [
        "goal, membership evaluations per CPU second, 3 peers, at least 200,000",
        "goal, CPU µs of a process activation with commit, at most 20",
        "goal, CPU µs of a packet of news, with a relay planned, at most 15",
        "goal, CPU µs of a packet of what is known, at most 3",
        "goal, CPU ms per second of the chapter's robot with 4 peers, at most 0.6",
    ]
    assert figures["memberships_per_cpu_s"] > 0 and figures["robot_second_cpu_ms"] > 0
    assert figures["fresh_packet_cpu_us"] > 0
    assert figures["task"]["peers"] == 4
