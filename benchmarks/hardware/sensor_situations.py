"""What happens to robots whose sensors are right: nobody may be accused of anything."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError, check_pose
from actors.geometry import Point, Pose
from actors.installation.repository import SHIPPED
from actors.messages import Scan
from actors.randomness import generator
from benchmarks.hardware.sensor_rig import Pilot, SensorRig
from firmware_bridge.kobuki.safety import HoldCause

FLOORS: Final = tuple(SHIPPED / "maps" / f"{name}.yaml" for name in ("corridor", "maze", "apartment"))
_CELL: Final = 0.05
_ROOM: Final = 0.6
"""Free floor round a start, m."""
_APART: Final = 1.2
ACCUSATIONS: Final = frozenset(HoldCause) - {
    HoldCause.NO_FEEDBACK,
    HoldCause.LINK_RECOVERING,
    HoldCause.WHEEL_DROP,
    HoldCause.PUT_DOWN,
    HoldCause.BUMPER,
    HoldCause.BLIND,
    HoldCause.NO_COMMAND,
    HoldCause.STALE_COMMAND,
    HoldCause.BLOCKED,
}
"""Causes that accuse a sensor; a robot that is blocked is rightly told so."""


class Straight(Pilot):
    """Drives on as it was told, whatever comes."""

    def __init__(self, v: float, omega: float = 0.0) -> None:
        self._wish = v, omega

    def steer(self, scan: Scan | None) -> tuple[float, float]:
        """Always the same."""
        return self._wish


@dataclass(frozen=True)
class SensorSituation:
    """Something that happens."""

    name: str
    build: Callable[[int, Path], SensorRig]
    """Of a seed and a folder for floors."""
    time_s: float = 120.0
    event: Callable[[SensorRig], None] | None = None
    """Half way."""
    robots: int = 1


def starts_on(floor: Path, seed: int, count: int) -> list[tuple[float, float, float]]:
    """Free poses, apart from one another."""
    grid, random = load_map(floor), generator(seed, "starts", floor.name)
    rows, columns = grid.blocking.shape
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        x = grid.origin[0] + random.random() * columns * grid.resolution
        y = grid.origin[1] + random.random() * rows * grid.resolution
        if any(math.dist((x, y), one[:2]) < _APART for one in found):
            continue
        try:
            check_pose(grid, Point(x, y), _ROOM, "r1")
        except PlacementError:
            continue
        found.append((x, y, float(random.uniform(-math.pi, math.pi))))
    return found


def accusations(rig: SensorRig) -> Iterator[tuple[str, float, str]]:
    """Robot, instant, s, and cause of each."""
    for name, vehicle in rig.vehicles.items():
        before: frozenset[HoldCause] = frozenset()
        for told in vehicle.told:
            for cause in sorted((told.causes - before) & ACCUSATIONS, key=lambda one: one.name):
                yield name, told.instant / 1e6, cause.name
            before = told.causes


def plain_floor(folder: Path, width: float, depth: float) -> Path:
    """A rectangle with four walls and nothing in it, m."""
    cells = np.full((round(depth / _CELL) + 8, round(width / _CELL) + 8), 254, np.uint8)
    cells[:4], cells[-4:], cells[:, :4], cells[:, -4:] = 0, 0, 0, 0
    path = folder / f"{width:g}x{depth:g}.yaml"
    rows, columns = cells.shape
    path.with_suffix(".pgm").write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + cells.tobytes())
    path.write_text(
        f"image: {path.stem}.pgm\nresolution: {_CELL}\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


def _wander(floor: int, robots: int, speed: float) -> Callable[[int, Path], SensorRig]:
    def build(seed: int, _: Path) -> SensorRig:
        return SensorRig(FLOORS[floor], starts_on(FLOORS[floor], seed, robots), seed, speed)

    return build


def _convoy(seed: int, folder: Path) -> SensorRig:
    """Five robots side by side and behind one another in a corridor whose ends are out of sight."""
    offsets = ((0.0, 0.0), (0.9, 0.0), (-0.9, 0.0), (0.0, 0.9), (0.0, -0.9))
    starts = [(14.0 + x, 2.0 + y, 0.0) for x, y in offsets]
    rig = SensorRig(plain_floor(folder, 60.0, 4.0), starts, seed)
    for vehicle in rig.vehicles.values():
        vehicle.pilot = Straight(0.4)
    return rig


def _long_corridor(seed: int, folder: Path) -> SensorRig:
    rig = SensorRig(plain_floor(folder, 60.0, 3.0), [(14.0, 1.7, 0.01)], seed)
    rig.vehicles["r1"].pilot = Straight(0.5)
    return rig


def _hall(seed: int, folder: Path) -> SensorRig:
    """Nothing within reach of the lidar: blind, and standing."""
    return SensorRig(plain_floor(folder, 40.0, 40.0), [(20.0, 20.0, 0.3)], seed)


def _spin(seed: int, _: Path) -> SensorRig:
    rig = SensorRig(FLOORS[seed % 3], starts_on(FLOORS[seed % 3], seed, 1), seed)
    rig.vehicles["r1"].pilot = Straight(0.0, (-1.0) ** seed * (0.3 + 0.4 * (seed % 5)))
    return rig


def _stand(seed: int, _: Path) -> SensorRig:
    rig = SensorRig(FLOORS[seed % 3], starts_on(FLOORS[seed % 3], seed, 1), seed)
    rig.vehicles["r1"].pilot = Straight(0.0)
    return rig


def _backs_into_a_wall(seed: int, folder: Path) -> SensorRig:
    rig = SensorRig(plain_floor(folder, 6.0, 4.0), [(1.5, 2.0, 0.1 * (seed % 7))], seed)
    rig.vehicles["r1"].pilot = Straight(-0.3)
    return rig


def _pushed(seed: int, folder: Path) -> SensorRig:
    """One that drives slowly is pushed from behind and from the side by two that are faster."""
    starts = [(2.0, 2.0, 0.0), (1.3, 2.0, 0.0), (2.6, 1.1, math.pi / 2)]
    rig = SensorRig(plain_floor(folder, 12.0, 4.0), starts, seed)
    speeds = {"r1": 0.1, "r2": 0.4, "r3": 0.3}
    for name, vehicle in rig.vehicles.items():
        vehicle.pilot = Straight(speeds[name], 0.05 * (seed % 3 - 1))
    return rig


def _carried(rig: SensorRig) -> None:
    """The robot is put elsewhere in an instant, its wheels unmoved."""
    floor = FLOORS[0]
    x, y, heading = starts_on(floor, rig.now, 1)[0]
    rig.laboratory.carry("r1", Pose(x, y, heading))


_WANDERINGS: Final = (
    (0, 1, 0.5),
    (1, 1, 0.5),
    (2, 1, 0.5),
    (0, 1, 0.15),
    (2, 1, 0.3),
    (0, 6, 0.5),
    (2, 4, 0.4),
    (1, 3, 0.3),
)
"""Floor, robots, m/s."""
SITUATIONS: Final = (
    *(
        SensorSituation(
            f"{robots} wander in the {FLOORS[floor].stem} at {speed:g} m/s",
            _wander(floor, robots, speed),
            robots=robots,
        )
        for floor, robots, speed in _WANDERINGS
    ),
    SensorSituation("a convoy of 5 in a corridor without features", _convoy, 20.0, robots=5),
    SensorSituation("a long corridor without features", _long_corridor, 40.0),
    SensorSituation("a hall without an echo", _hall, 30.0),
    SensorSituation("turning on the spot", _spin),
    SensorSituation("standing", _stand, 180.0),
    SensorSituation("backing into a wall", _backs_into_a_wall, 30.0),
    SensorSituation("pushed by two others", _pushed, 20.0, robots=3),
    SensorSituation("carried elsewhere while it drives", _wander(0, 1, 0.5), 60.0, _carried),
)
