"""A robot in the loop whose processes are killed, stopped and held while it drives: when it stands, and where.

All processes as on board, the devices emulated in wall time. The emulated base goes on as it was last told, and
stands at once when told so: what a real one needs to brake comes on top.
"""

import json
import statistics
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from benchmarks.standstill_rig import GUARDIAN, NotDrivingError, Rig, held, killed, stopped
from firmware_bridge.laboratory.laboratory import RADIO, RANGE

PROCESSES: Final = {
    "robot": "actors.robot",
    "bridge": "firmware_bridge.onboard.bridge",
    "base": "firmware_bridge.onboard.base",
    "guardian": GUARDIAN,
    "supervisor": "onboard",
}
"""Each by a word of its command line."""
HARMLESS: Final = frozenset(
    {("bridge", "killed"), ("bridge", "stopped"), ("bridge", "held")}
    | {("supervisor", "stopped"), ("supervisor", "held")}
)
"""These leave a robot that knows where it is, sees and obeys: it may drive on."""
DEVICES: Final = {
    ("lidar", "silent"): f"silence r1 {RANGE}",
    ("lidar", "unplugged"): f"unplug r1 {RANGE}",
    ("lidar", "without echo"): "darken r1",
    ("lidar", "held fast"): "jam r1",
    ("base's feedback", "silent"): "silence r1 base",
    ("motor", "over-current"): "strain r1 left",
    ("battery", "nearly empty"): "battery r1 13.0",
    ("radio", "unplugged"): f"unplug r1 {RADIO}",
}


@dataclass(frozen=True)
class StandstillTask:
    """What is measured."""

    trials: int = 3
    goal_s: float = 0.3
    goal_m: float = 0.15


@dataclass(frozen=True)
class Standstill:
    """What one event came to."""

    time_s: float | None
    """Until the robot stood; None: it drove on."""
    way_m: float
    speed: float
    """Just before the event, m/s."""


Case = tuple[str, str]


def run(json_output: bool = False, task: StandstillTask | None = None) -> dict[str, object]:
    """Run, print and give what came of it."""
    task = task or StandstillTask()
    found: dict[Case, list[Standstill]] = defaultdict(list)
    for _ in range(task.trials):
        for case, event in events().items():
            found[case].append(_trial(event))
    figures = {
        "task": asdict(task),
        "cases": {" ".join(case): [asdict(one) for one in trials] for case, trials in found.items()},
        "goal_met": all(meets(case, trials, task) for case, trials in found.items()),
    }
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        _print(found, task)
    return figures


def events() -> dict[Case, Callable[[Rig], None]]:
    """What happens, by what it happens to and how."""
    ways = {"killed": killed, "stopped": stopped, "held": held}
    made: dict[Case, Callable[[Rig], None]] = {
        (process, way): lambda rig, word=word, act=act: act(rig.processes(word))  # type: ignore[misc]
        for process, word in PROCESSES.items()
        for way, act in ways.items()
    }
    for case, order in DEVICES.items():
        made[case] = lambda rig, order=order: rig.order(order)  # type: ignore[misc]
    return made


def meets(case: Case, trials: list[Standstill], task: StandstillTask) -> bool:
    """True if it stood in time each time, or may drive on."""
    if case in HARMLESS or case[0] == "radio":
        return True
    return all(
        one.time_s is not None and one.time_s <= task.goal_s and one.way_m <= task.goal_m for one in trials
    )


def _trial(event: Callable[[Rig], None]) -> Standstill:
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder, Rig(Path(folder)) as rig:
        try:
            rig.until_driving()
        except NotDrivingError as error:
            sys.stderr.write(f"{error}\n")
            return Standstill(None, 0.0, 0.0)
        before = rig.where()
        event(rig)
        after = rig.standing(patience_s=2.0)
        return Standstill(
            None if after is None else after.time - before.time,
            (after or rig.where()).way - before.way,
            before.speed,
        )


def _print(found: dict[Case, list[Standstill]], task: StandstillTask) -> None:
    console = Console()
    table = Table("what", "how", "median", "worst", "way", "", title="until the robot stands")
    for case, trials in found.items():
        times = [one.time_s for one in trials if one.time_s is not None]
        driven_on = len(trials) - len(times)
        words = ("drives on", "") if not times else (f"{statistics.median(times):.2f} s", f"{max(times):.2f} s")
        if times and driven_on:
            words = (words[0], f"{driven_on} drove on")
        verdict = "may drive on" if case in HARMLESS or case[0] == "radio" else ""
        if not meets(case, trials, task):
            verdict = "MISSED"
        table.add_row(*case, *words, f"{max(one.way_m for one in trials):.2f} m", verdict)
    console.print(table)
    console.print(
        f"goal: {task.goal_s:g} s and {task.goal_m:g} m; {task.trials} trials each, worst way; "
        f"speeds {min(o.speed for t in found.values() for o in t):.2f} to "
        f"{max(o.speed for t in found.values() for o in t):.2f} m/s",
        highlight=False,
        soft_wrap=True,
    )
