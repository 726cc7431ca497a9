"""A budget of CPU time: what each part of a swarm costs per robot and second."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from benchmarks.swarm.part_clock import Account, Overhead

Key = tuple[str, str]
"""Actor and part."""
REST = "rest"


class Line(NamedTuple):
    """One part of one actor."""

    actor: str
    part: str
    ms: float
    """CPU ms per robot and simulated second."""


def budget(
    accounts: Mapping[Key, Account], total_ns: int, overhead: Overhead, robot_s: float
) -> tuple[list[Line], float]:
    """A line for each account, and REST, without what the clock cost; and the ms that the clock cost.

    The lines and the clock's cost add up to `total_ns`. `robot_s`: robots times simulated seconds.
    """
    per = 1e6 * robot_s
    calls = sum(account.calls for account in accounts.values())
    clock_ms = calls * (overhead.inside_ns + overhead.outside_ns) / per
    lines = [Line(*key, _net_ns(account, overhead) / per) for key, account in accounts.items()]
    rest_ms = total_ns / per - clock_ms - sum(line.ms for line in lines)
    return [*lines, Line("", REST, rest_ms)], clock_ms


def _net_ns(account: Account, overhead: Overhead) -> float:
    return account.spent_ns - account.calls * overhead.inside_ns - account.inner * overhead.outside_ns


def whole(lines: Sequence[Line]) -> float:
    """Of all lines, ms."""
    return sum(line.ms for line in lines)


def with_processes(lines: Sequence[Line], by_actor: Mapping[str, float], part: str) -> list[Line]:
    """The lines, and for each kind of process what it costs beyond its lines, so that all add up to it.

    `by_actor`: CPU ms per robot and simulated second of all processes of a kind. REST, which is no
    process's, is left out: what drives the actors there is not what drives them in processes.
    """
    own = [line for line in lines if line.actor in by_actor]
    beyond = [
        Line(actor, part, ms - whole([line for line in own if line.actor == actor]))
        for actor, ms in by_actor.items()
    ]
    return [*own, *beyond]
