"""The arithmetic of a budget: it adds up to the whole; and the goals that swarms are judged by."""

import math
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.swarm.in_memory import MemoryFigures
from benchmarks.swarm.over_mesh import MeshFigures
from benchmarks.swarm.part_clock import (
    REST,
    Account,
    BudgetLine,
    Key,
    Overhead,
    budget,
    whole,
    with_processes,
)
from benchmarks.swarm.process_figures import Memory
from benchmarks.swarm.tables import SwarmFigures, judged
from benchmarks.swarm.task import Range, SwarmTask

COUNTS = st.integers(0, 10**6)
ACCOUNTS = st.dictionaries(
    st.tuples(st.sampled_from(("world", "radio", "robots")), st.text(min_size=1, max_size=3)),
    st.builds(Account, COUNTS, COUNTS, COUNTS),
    max_size=8,
)


@given(ACCOUNTS, COUNTS, st.floats(0, 500), st.floats(0, 500))
def test_lines_and_clock_add_up_to_the_whole(
    accounts: dict[Key, Account], own_ns: int, inside_ns: float, outside_ns: float
) -> None:
    total_ns = own_ns + sum(account.spent_ns for account in accounts.values())
    lines, clock_ms = budget(accounts, total_ns, Overhead(inside_ns, outside_ns), robot_s=40.0)
    assert math.isclose(whole(lines) + clock_ms, total_ns / 40.0 / 1e6, rel_tol=1e-9, abs_tol=1e-9)
    assert [line.part for line in lines[:-1]] == [part for _, part in accounts] and lines[-1].part == REST


def test_a_line_is_net_of_its_own_calls_and_of_those_it_makes() -> None:
    accounts = {
        ("robots", "driver"): Account(spent_ns=9_000, calls=10, inner=20),
        ("robots", "scan"): Account(spent_ns=5_000, calls=20),
    }
    lines, clock_ms = budget(accounts, 20_000, Overhead(inside_ns=100, outside_ns=50), robot_s=2.0)
    assert lines[:2] == [BudgetLine("robots", "driver", 0.0035), BudgetLine("robots", "scan", 0.0015)]
    assert clock_ms == pytest.approx(0.00225)
    assert lines[2].ms == pytest.approx((20_000 - 7_000 - 3_000 - 4_500) / 2e6)


def test_what_processes_cost_beyond_their_parts_fills_each_actor_up() -> None:
    lines = [
        BudgetLine("world", "scans", 1.0),
        BudgetLine("robots", "driver", 0.5),
        BudgetLine("", REST, 0.3),
    ]
    filled = with_processes(lines, {"world": 1.25, "robots": 0.4, "parent": 0.1}, "mesh")
    assert filled[:2] == lines[:2]
    assert [(line.actor, line.part, round(line.ms, 9)) for line in filled[2:]] == [
        ("world", "mesh", 0.25),
        ("robots", "mesh", -0.1),
        ("parent", "mesh", 0.1),
    ]


def swarm(
    robots: int,
    speed: float,
    ms: float = 5.0,
    memory_ms: float = 1.0,
    start_s: float = 6.0,
    pss_mb: float = 25.0,
) -> SwarmFigures:
    """Figures that somebody might have measured."""
    mesh = Mock(spec=MeshFigures)
    mesh.real_time_factor, mesh.ms, mesh.startup_s = (Range.of([value]) for value in (speed, ms, start_s))
    mesh.memory = {"robots": Memory(robots, 0.0, pss_mb * robots, 0.0)}
    found = Mock(spec=SwarmFigures, robots=robots, mesh=mesh)
    found.memory = Mock(spec=MemoryFigures, ms=memory_ms)
    return found


def test_goals_are_judged_where_their_swarms_were_measured() -> None:
    goals = judged(
        [swarm(4, 100.0, memory_ms=2.6), swarm(20, 15.9), swarm(100, 2.0, 6.6, memory_ms=5.0, start_s=6.1)]
    )
    assert [(goal.words.partition(" robots: ")[0], goal.figure, goal.goal, goal.met) for goal in goals] == [
        ("4", 100.0, 100.0, True),
        ("20", 15.9, 16.0, False),
        ("100", 2.0, 2.0, True),
        ("4", pytest.approx(3846.2, abs=0.1), 4000.0, False),
        ("20", 10_000.0, 3180.0, True),
        ("100", 2000.0, 2000.0, True),
        ("100", pytest.approx(1.32), 1.3, False),
        ("100", 6.1, 6.0, False),
        ("100", 25.0, 25.0, True),
    ]
    assert [goal.words for goal in judged([swarm(10, 1.0)])] == [
        "10 robots: robot-steps per second of one core in memory, as over Zenoh on all, at least 100"
    ]
    assert judged([Mock(spec=SwarmFigures, robots=200, mesh=None)]) == []


def test_many_robots_run_for_less_time_and_never_for_none() -> None:
    task = SwarmTask()
    assert [task.simulated_s(robots) for robots in (1, 4, 20, 50, 100, 500)] == [60, 60, 40, 16, 8, 2]
    assert SwarmTask(seconds=90.0, robot_seconds=None).simulated_s(500) == 90.0
    assert SwarmTask(seconds=1.0).simulated_s(500) == 1.0
