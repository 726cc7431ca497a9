"""Robots as on board, each process in a network namespace of its own: they can talk by serial bytes only.

How punctual they are, what they made of a head-on meeting, and whether their recordings execute again.
"""

import tempfile
from pathlib import Path
from typing import Final

from rich.table import Table

from actors.installation.repository import SHIPPED
from actors.processes.launch import Launcher
from actors.runtime.errors import AcrcError
from benchmarks.measured import Measured
from deploy.laboratory import hardware_in_the_loop
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay import record_replay

NO_NETWORK: Final = ("unshare", "--map-root-user", "--net")
"""util-linux; a namespace without a single link that is up."""


HEAD_ON: Final = SHIPPED / "scenarios" / "head_on.toml"
LATE_GOAL_MS: Final = 20
"""99 % of the steps are to be answered within this; said, and no part of the verdict: it is the machine's."""
_EQUAL: Final = "messages, all equal"


def check(robots: int = 3, duration: float = 300.0, scenario: Path = HEAD_ON) -> Measured:
    """Run them for at most so long, s of wall time; it ends when nobody has a place left.

    It holds where each robot heard another one, and does all again from what it received.
    """
    plan = load_scenario(scenario, Overrides(robots=robots, duration=duration))
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        options = RunOptions(out, spawn="exec", hardware=True, json=True)
        result = hardware_in_the_loop.run(plan, options, Launcher("exec", NO_NETWORK, reap=False))
        again = {robot: _again(out, robot) for robot in result.per_robot}
    late = {name: (robot.lateness_p50_ms, robot.lateness_p99_ms) for name, robot in result.per_robot.items()}
    heard = {name: robot.frames["copies_heard"] for name, robot in result.per_robot.items()}
    figures: dict[str, object] = {
        "task": {"scenario": str(scenario), "robots": robots, "duration": duration},
        "lateness_p50_p99_ms": late,
        "places_done": result.places_done,
        "places_claimed": result.places_claimed,
        "places_total": result.places_total,
        "exchanges": dict(result.deeco.exchanges),
        "copies_heard": heard,
        "contacts": result.contacts,
        "executed_again": again,
        "goal_met": all(p99 is not None and p99 <= LATE_GOAL_MS for _, p99 in late.values()),
    }
    holds = min(heard.values()) > 0 and all(word.endswith(_EQUAL) for word in again.values())
    return Measured(figures, _shown(figures, late, again), holds)


def _again(out: Path, robot: str) -> str:
    """Execute a robot again from what it received."""
    try:
        return f"{record_replay.replay_actor(out, robot).outputs} {_EQUAL}"
    except AcrcError as error:
        return str(error)


def _shown(
    figures: dict[str, object], late: dict[str, tuple[int | None, int | None]], again: dict[str, str]
) -> tuple[Table | str, ...]:
    table = Table("robot", "late p50", "late p99", "replayed", title="robots on board, without network")
    for robot, delays in late.items():
        table.add_row(robot, *("-" if one is None else f"{one} ms" for one in delays), again[robot])
    done = (
        f"{figures['places_done']} of {figures['places_total']} places done, "
        f"exchanges {figures['exchanges']}, {figures['contacts']} contacts"
    )
    goal = f"goal, 99 % of the steps answered within {LATE_GOAL_MS} ms"
    return table, done, f"{goal}: {'met' if figures['goal_met'] else 'MISSED'}"
