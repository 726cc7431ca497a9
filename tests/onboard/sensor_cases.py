"""Faults of sensors and lines, and situations without faults, in which none may be reported."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError, check_pose
from actors.geometry import Point, Pose
from actors.installation.repository import SHIPPED
from actors.randomness import generator
from firmware_bridge.safety import HoldCause
from tests.onboard.sensor_rig import LidarFault, SensorRig, Starts, Straight

Act = Callable[[SensorRig], None]
AT_ONCE = (0.3, 0.15)
"""Limits, s and m, of faults that one message shows."""
BY_COMPARISON = (1.0, 0.5)
"""Limits of faults that are found by comparing two sensors."""
FROM_REST = (1.5, 0.5)
"""Limits of faults from before the robot moved: it accelerates by 0.3 m/s²."""


class SensorFault(NamedTuple):
    act: Act
    limit: tuple[float, float] | None = BY_COMPARISON
    """Limit until the stop command, s and m; None: only measured."""
    in_arc: bool = False
    """True if detectable in turns only."""
    from_start: bool = False
    """True if present before the robot first moves."""


def base(**values: object) -> Act:
    def act(rig: SensorRig) -> None:
        for name, value in values.items():
            setattr(rig.laboratory.robots["r1"].base.faults, name, value)

    return act


def lidar(fault: LidarFault) -> Act:
    return lambda rig: rig.lidars["r1"].fail(fault)


def device(name: str) -> Act:
    return lambda rig: setattr(rig.lidars["r1"], name, True)


def noise(share: float, ways: str) -> Act:
    def act(rig: SensorRig) -> None:
        vehicle = rig.vehicles["r1"]
        vehicle.disturb(share, ways)
        if ways == "out":  # feedback is intact, so command a stop
            vehicle.pilot = None
            vehicle.bot.command(rig.now, rig.now, 0.0, 0.0)

    return act


FAULTS = {
    "lidar: repeats one turn": SensorFault(lidar(LidarFault(turns=1)), AT_ONCE),
    "lidar: repeats 5 turns": SensorFault(lidar(LidarFault(turns=5)), AT_ONCE),
    "lidar: half of each turn repeated": SensorFault(lidar(LidarFault(turns=1, share=0.5)), AT_ONCE),
    "lidar: every other beam repeated": SensorFault(lidar(LidarFault(turns=1, comb=True))),
    "lidar: one turn, with fresh noise": SensorFault(lidar(LidarFault(turns=1, noisy=True))),
    "lidar: turned by 90°": SensorFault(lidar(LidarFault(turned_deg=90.0))),
    "lidar: turned by 90°, from the start": SensorFault(
        lidar(LidarFault(turned_deg=90.0)), FROM_REST, from_start=True
    ),
    "lidar: turned by -45°": SensorFault(lidar(LidarFault(turned_deg=-45.0))),
    "lidar: turned by 180°": SensorFault(lidar(LidarFault(turned_deg=180.0))),
    "lidar: mirrored": SensorFault(lidar(LidarFault(mirrored=True)), in_arc=True),
    "lidar: 1 s late, from the start": SensorFault(lidar(LidarFault(late_s=1.0)), FROM_REST, from_start=True),
    "both encoders: stand still": SensorFault(base(left_scale=0.0, right_scale=0.0)),
    "both encoders: count double": SensorFault(base(left_scale=2.0, right_scale=2.0)),
    "both encoders: count backward": SensorFault(base(left_scale=-1.0, right_scale=-1.0)),
    "left encoder: stands still": SensorFault(base(left_scale=0.0)),
    "right encoder: stands still": SensorFault(base(right_scale=0.0)),
    "left encoder: counts double": SensorFault(base(left_scale=2.0)),
    "right encoder: counts backward": SensorFault(base(right_scale=-1.0)),
    "gyro: turns at 0.5 rad/s for ever": SensorFault(base(gyro_drift=0.5)),
    "gyro: stands still": SensorFault(base(gyro="frozen"), in_arc=True),
    "gyro: sign reversed": SensorFault(base(gyro_scale=-1.0), in_arc=True),
    "gyro: says double": SensorFault(base(gyro_scale=2.0), in_arc=True),
    **{f"lidar: {name}": SensorFault(device(name), AT_ONCE) for name in ("dark", "stuck", "silent")},
    "base: silent": SensorFault(base(silent=True), AT_ONCE),
    "base: motor over-current": SensorFault(base(overcurrent=1), AT_ONCE),
    "base: battery nearly empty": SensorFault(base(battery=13.0), AT_ONCE),
    "guardian: gone": SensorFault(lambda rig: rig.vehicles["r1"].guardian.leave(), AT_ONCE),
    "base's clock: stands still": SensorFault(base(stamp="frozen"), AT_ONCE),
    "base's clock: goes backward": SensorFault(base(stamp="backward"), AT_ONCE),
    "base's clock: jumps": SensorFault(base(stamp="jumping"), AT_ONCE),
    **{
        f"line to the base: {share:.0%} noise, {ways}": SensorFault(
            noise(share, ways), AT_ONCE if share <= 0.3 and ways != "out" else None
        )
        for share in (0.05, 0.1, 0.3, 0.6)
        for ways in ("both", "in", "out")
    },
}

FLOORS = tuple(SHIPPED / "maps" / f"{name}.yaml" for name in ("corridor", "maze", "apartment"))
CELL, CLEARANCE, APART = 0.05, 0.6, 1.2
"""m."""
_RIGHT = (
    "NO_FEEDBACK LINK_RECOVERING WHEEL_DROP PUT_DOWN BUMPER NO_RANGE_DATA NO_COMMAND STALE_COMMAND BLOCKED"
)
REPORTS = frozenset(HoldCause) - {HoldCause[name] for name in _RIGHT.split()}
"""Causes that report a sensor fault; a blocked robot is reported correctly."""


def reports(rig: SensorRig) -> Iterator[tuple[str, float, str]]:
    """Yield robot, time, s, and cause of each reported sensor fault."""
    for name, vehicle in rig.vehicles.items():
        before: frozenset[HoldCause] = frozenset()
        for change in vehicle.held:
            for cause in sorted((change.causes - before) & REPORTS, key=lambda one: one.name):
                yield name, change.instant / 1e6, cause.name
            before = change.causes


def starts_on(floor: Path, seed: int, count: int) -> list[tuple[float, float, float]]:
    """Return random free poses with distance from each other."""
    grid, random = load_map(floor), generator(seed, "starts", floor.name)
    rows, columns = grid.blocking.shape
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        x = grid.origin[0] + random.random() * columns * grid.resolution
        y = grid.origin[1] + random.random() * rows * grid.resolution
        if any(math.dist((x, y), one[:2]) < APART for one in found):
            continue
        try:
            check_pose(grid, Point(x, y), CLEARANCE, "r1")
        except PlacementError:
            continue
        found.append((x, y, float(random.uniform(-math.pi, math.pi))))
    return found


def plain_floor(folder: Path, width: float, depth: float) -> Path:
    """Write the map of an empty room, m."""
    cells = np.full((round(depth / CELL) + 8, round(width / CELL) + 8), 254, np.uint8)
    cells[:4], cells[-4:], cells[:, :4], cells[:, -4:] = 0, 0, 0, 0
    path = folder / f"{width:g}x{depth:g}.yaml"
    rows, columns = cells.shape
    path.with_suffix(".pgm").write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + cells.tobytes())
    path.write_text(
        f"image: {path.stem}.pgm\nresolution: {CELL}\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


class SensorSituation(NamedTuple):
    build: Callable[[int, Path], SensorRig]
    """Builds it from a seed and a folder for maps."""
    time_s: float = 120.0
    robots: int = 1
    event: Act | None = None
    """Executed at half of the time."""


def wander(floor: int, robots: int, speed: float) -> Callable[[int, Path], SensorRig]:
    return lambda seed, _: SensorRig(FLOORS[floor], starts_on(FLOORS[floor], seed, robots), seed, speed)


def driven(
    velocities: Callable[[int], dict[str, tuple[float, float]]],
    room: tuple[float, float] | None,
    starts: Callable[[int], Starts] = lambda seed: starts_on(FLOORS[seed % 3], seed, 1),
) -> Callable[[int, Path], SensorRig]:
    """Return a builder of robots with constant velocities, in an empty room, m, or on one of the floors."""

    def build(seed: int, folder: Path) -> SensorRig:
        floor = FLOORS[seed % 3] if room is None else plain_floor(folder, *room)
        rig = SensorRig(floor, starts(seed), seed)
        for name, velocity in velocities(seed).items():
            rig.vehicles[name].pilot = Straight(*velocity)
        return rig

    return build


def carry(rig: SensorRig) -> None:
    """Move the robot to another pose without turning its wheels."""
    x, y, heading = starts_on(FLOORS[0], rig.now, 1)[0]
    rig.laboratory.move_robot("r1", Pose(x, y, heading))


def pushing(seed: int) -> dict[str, tuple[float, float]]:
    return {name: (v, 0.05 * (seed % 3 - 1)) for name, v in (("r1", 0.1), ("r2", 0.4), ("r3", 0.3))}


CONVOY = [(14.0 + x, 2.0 + y, 0.0) for x, y in ((0, 0), (0.9, 0), (-0.9, 0), (0, 0.9), (0, -0.9))]
CONVOY_OF = ("r1", "r2", "r3", "r4", "r5")
PUSHED = [(2.0, 2.0, 0.0), (1.3, 2.0, 0.0), (2.6, 1.1, math.pi / 2)]
WANDERINGS = (
    (0, 1, 0.5), (1, 1, 0.5), (2, 1, 0.5), (0, 1, 0.15), (2, 1, 0.3), (0, 6, 0.5), (2, 4, 0.4), (1, 3, 0.3),
)  # fmt: skip
"""Floor, robots, m/s."""
SITUATIONS = {
    **{
        f"{robots} wander in the {FLOORS[floor].stem} at {v:g} m/s":
        SensorSituation(wander(floor, robots, v), robots=robots)
        for floor, robots, v in WANDERINGS
    },
    "a convoy of 5 in a corridor without features": SensorSituation(
        driven(lambda _: dict.fromkeys(CONVOY_OF, (0.4, 0.0)), (60.0, 4.0), lambda _: CONVOY),
        20.0, 5,
    ),
    "a long corridor without features": SensorSituation(
        driven(lambda _: {"r1": (0.5, 0.0)}, (60.0, 3.0), lambda _: [(14.0, 1.7, 0.01)]), 40.0
    ),
    "a hall without an echo": SensorSituation(
        driven(lambda _: {}, (40.0, 40.0), lambda _: [(20.0, 20.0, 0.3)]), 30.0
    ),
    "turning on the spot": SensorSituation(
        driven(lambda seed: {"r1": (0.0, (-1.0) ** seed * (0.3 + 0.4 * (seed % 5)))}, None)
    ),
    "standing": SensorSituation(driven(lambda _: {"r1": (0.0, 0.0)}, None), 180.0),
    "backing into a wall": SensorSituation(
        driven(lambda _: {"r1": (-0.3, 0.0)}, (6.0, 4.0), lambda seed: [(1.5, 2.0, 0.1 * (seed % 7))]), 30.0
    ),
    "pushed by two others": SensorSituation(driven(pushing, (12.0, 4.0), lambda _: PUSHED), 20.0, 3),
    "carried elsewhere while it drives": SensorSituation(wander(0, 1, 0.5), 60.0, event=carry),
}  # fmt: skip
