"""What a robot's navigation decided, cycle by cycle, and from what; see docs/navigation-log.md.

A run in memory, of which one robot is then replayed from its recording: what it decides is the same,
byte by byte, and somebody looks on.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.map_file import load_map
from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import SENSES, Senses
from actors.robot.core import RobotCore
from actors.robot.local_planning.steering import BaseLocalPlanner, Cycle
from actors.robot.stack import Stack
from actors.robot.sweep import Sweeps
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.codec import decode
from actors.runtime.core import Core, at
from actors.runtime.recording import Entry, read_recording
from benchmarks.localisation.log import map_members, pack
from benchmarks.navigation.course import NavigationCourse, body, scenario
from benchmarks.statistics.runs import in_memory
from observation.replay.record_replay import Onlook, replay_actor

FORMAT: Final = "acrc-navigation-log"
VERSION: Final = 1
CYCLES: Final = (
    "time_us,odometry_x,odometry_y,odometry_heading,map_x,map_y,map_heading,vx,vy,omega,"
    "corner_row,corner_column,plan,turning,valid,command_vx,command_omega"
)


@dataclass(frozen=True)
class Written:
    """What a log holds."""

    cycles: int
    plans: int
    invalid: int
    """Cycles without a valid trajectory."""


def write(file: Path, course: NavigationCourse, robot: str = "r1") -> Written:
    """Run the course, and write down what one robot decided. Raises LogError."""
    with in_memory(scenario(course)) as (plan, _):
        cycles, scans = _cycles(plan.out, robot), _scans(plan.out, robot)
    members, written = _members(course, plan.stack, cycles)
    members["scans.csv"] = "\n".join([_scan_columns(), *scans, ""])
    pack(file, members)
    return written


def _cycles(out: Path, robot: str) -> list[Cycle]:
    cycles: list[Cycle] = []

    def look_on(core: Core, _step_us: int) -> None:
        assert isinstance(core, RobotCore) and isinstance(core.navigation.local_planner, BaseLocalPlanner)
        core.navigation.local_planner.witness = cycles.append

    replay_actor(out, robot, Onlook(look_on))
    return cycles


def _scans(out: Path, robot: str) -> list[str]:
    """What the local map was made from: each scan with the odometry's pose at its stamp."""
    sweeps, rows = Sweeps(body().sensor), []
    for item in read_recording(out / robot / f"{robot}.mcap"):
        if not isinstance(item, Entry) or item.payload is None or item.key != at(SENSES, robot).key:
            continue
        senses = decode(topic_of(item.key), item.key, item.payload)
        assert isinstance(senses, Senses)
        odometry = senses.odometry
        sweeps.take(Instant(senses.instant), Pose(odometry.x, odometry.y, odometry.heading), None)
        for scan in (*senses.earlier_scans, *filter(None, (senses.scan,))):
            sweep = sweeps.placed(scan)
            rows.append(",".join(map(repr, (scan.stamp, *sweep.pose, *sweep.ranges_mm.tolist()))))
    return rows


def _scan_columns() -> str:
    rays = ",".join(f"r{ray}" for ray in range(body().sensor.rays))
    return f"time_us,odometry_x,odometry_y,odometry_heading,{rays}"


def _members(
    course: NavigationCourse, stack: Stack, cycles: list[Cycle]
) -> tuple[dict[str, str | bytes], Written]:
    plans: list[NDArray[np.float64]] = []
    rows = []
    for cycle in cycles:
        if not plans or plans[-1] is not cycle.way:  # a plan stays the same object until the next one
            plans.append(cycle.way)
        rows.append(_row(cycle, len(plans) - 1))
    points = [f"{number},{x!r},{y!r}" for number, plan in enumerate(plans) for x, y in plan.tolist()]
    members: dict[str, str | bytes] = {
        "about.json": json.dumps(_about(stack, cycles), indent=2) + "\n",
        **map_members(load_map(course.map)),
        "cycles.csv": "\n".join([CYCLES, *rows, ""]),
        "plans.csv": "\n".join(["plan,x,y", *points, ""]),
        "costs.bin": b"".join(cycle.costs.tobytes() for cycle in cycles),
    }
    return members, Written(len(cycles), len(plans), sum(not cycle.steering.valid for cycle in cycles))


def _row(cycle: Cycle, plan: int) -> str:
    twist, valid = cycle.steering
    numbers = (*cycle.here, *cycle.estimate, *cycle.velocity, *cycle.corner, plan)
    flags = (int(cycle.turning), int(valid))
    return ",".join(map(repr, (cycle.instant, *numbers, *flags, twist.vx, twist.omega)))


def _about(stack: Stack, cycles: list[Cycle]) -> dict[str, Any]:
    model = body()
    return {
        "format": FORMAT,
        "version": VERSION,
        "window": len(cycles[0].costs) if cycles else 0,
        "radius": model.footprint.circumradius,
        "drive": model.drive.model_dump(),
        "sensor": model.sensor.model_dump(),
        "local_map": asdict(stack.local_map),
        "dwa": asdict(stack.dwa),
        "planner": asdict(stack.planner),
    }
