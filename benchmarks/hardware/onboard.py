"""Robots as on board, each process in a network namespace of its own: they can talk by serial bytes only.

How punctual they are, what they made of a head-on meeting, and whether their recordings execute again.
"""

import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from actors.installation.repository import REPOSITORY
from actors.processes.launch import ServedLauncher
from actors.runtime.errors import AcrcError
from deploy.laboratory import hardware_in_the_loop
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay import record_replay

NO_NETWORK: Final = ("unshare", "--map-root-user", "--net")
"""util-linux; a namespace without a single link that is up."""


@dataclass(frozen=True)
class OnboardTask:
    """What is measured."""

    scenario: Path = REPOSITORY / "scenarios" / "head_on.toml"
    robots: int = 3
    duration: float = 300.0
    """At most so long, s of wall time; it ends when nobody has a place left."""
    late_goal_ms: int = 20
    """99 % of the steps are to be answered within this."""


def run(json_output: bool = False, task: OnboardTask | None = None) -> dict[str, object]:
    """Run, print and give what came of it."""
    task = task or OnboardTask()
    scenario = load_scenario(task.scenario, Overrides(robots=task.robots, duration=task.duration))
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out = Path(folder) / "out"
        options = RunOptions(out, spawn="exec", hardware=True, json=json_output)
        result = hardware_in_the_loop.run(scenario, options, ServedLauncher("exec", NO_NETWORK, reap=False))
        again = {robot: _again(out, robot) for robot in result.per_robot}
    late = {name: (robot.lateness_p50_ms, robot.lateness_p99_ms) for name, robot in result.per_robot.items()}
    figures: dict[str, object] = {
        "task": asdict(task) | {"scenario": str(task.scenario)},
        "lateness_p50_p99_ms": late,
        "places_done": result.places_done,
        "places_claimed": result.places_claimed,
        "places_total": result.places_total,
        "exchanges": dict(result.deeco.exchanges),
        "copies_heard": {name: robot.frames["copies_heard"] for name, robot in result.per_robot.items()},
        "contacts": result.contacts,
        "executed_again": again,
        "goal_met": all(p99 is not None and p99 <= task.late_goal_ms for _, p99 in late.values()),
    }
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        _print(figures, late, again, task)
    return figures


def _again(out: Path, robot: str) -> str:
    """Execute a robot again from what it received."""
    try:
        return f"{record_replay.replay_actor(out, robot).outputs} messages, all equal"
    except AcrcError as error:
        return str(error)


def _print(
    figures: dict[str, object],
    late: dict[str, tuple[int | None, int | None]],
    again: dict[str, str],
    task: OnboardTask,
) -> None:
    console = Console()
    table = Table("robot", "late p50", "late p99", "executed again", title="robots on board, without network")
    for robot, delays in late.items():
        table.add_row(robot, *("-" if one is None else f"{one} ms" for one in delays), again[robot])
    console.print(table)
    console.print(
        f"{figures['places_done']} of {figures['places_total']} places done, "
        f"exchanges {figures['exchanges']}, {figures['contacts']} contacts",
        highlight=False,
        soft_wrap=True,
    )
    goal = f"goal, 99 % of the steps answered within {task.late_goal_ms} ms"
    console.print(f"{goal}: {'met' if figures['goal_met'] else 'MISSED'}", highlight=False)
