"""The arithmetic of a budget: it adds up to the whole, and names what grows."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.swarm import speed_goals
from benchmarks.swarm.budget import REST, Growth, Key, Line, budget, growth, whole, with_processes
from benchmarks.swarm.part_clock import Account, Overhead

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
    assert lines[:2] == [Line("robots", "driver", 0.0035), Line("robots", "scan", 0.0015)]
    assert clock_ms == pytest.approx(0.00225)
    assert lines[2].ms == pytest.approx((20_000 - 7_000 - 3_000 - 4_500) / 2e6)


def test_what_processes_cost_beyond_their_parts_fills_each_actor_up() -> None:
    lines = [Line("world", "scans", 1.0), Line("robots", "driver", 0.5), Line("", REST, 0.3)]
    filled = with_processes(lines, {"world": 1.25, "robots": 0.4, "parent": 0.1}, "mesh")
    assert filled[:2] == lines[:2]
    assert [(line.actor, line.part, round(line.ms, 9)) for line in filled[2:]] == [
        ("world", "mesh", 0.25),
        ("robots", "mesh", -0.1),
        ("parent", "mesh", 0.1),
    ]


def test_growth_names_the_line_that_grows_most_first_and_shares_add_up() -> None:
    few = [Line("world", "scans", 1.0), Line("world", "physics", 0.8), Line("radio", "old", 0.2)]
    many = [Line("world", "scans", 1.5), Line("world", "physics", 0.3), Line("radio", "medium", 2.0)]
    rows = growth(few, many)
    assert [(row.part, row.factor) for row in rows] == [
        ("medium", None),
        ("scans", 1.5),
        ("old", 0.0),
        ("physics", pytest.approx(0.375)),
    ]
    assert sum(row.share for row in rows) == pytest.approx(1.0)
    assert growth(few, few)[0] == Growth("world", "scans", 1.0, 1.0, 0.0)


class Swarm:
    """Figures that somebody might have measured."""

    def __init__(self, robots: int, speed: float, cost_ms: float) -> None:
        self.robots, self.speed, self.cost_ms = robots, speed, cost_ms


def test_goals_are_judged_where_their_swarms_were_measured() -> None:
    goals = speed_goals.judged([Swarm(4, 40.0, 2.0), Swarm(20, 7.9, 6.1), Swarm(50, 3.0, 3.2)])
    assert [(goal.figure, goal.goal, goal.met) for goal in goals] == [
        (40.0, 40.0, True),
        (7.9, 8.0, False),
        (3.0, 3.0, True),
        (6.1, 6.0, False),
        (1.6, 1.6, True),
    ]
    assert speed_goals.judged([Swarm(10, 1.0, 9.0)]) == []
    assert [goal.robots for goal in speed_goals.judged([Swarm(50, 1.0, 1.0)])] == [(50,)]
