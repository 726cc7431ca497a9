"""Emulated devices in an empty room on pseudo-terminals, in real time.

`python -m firmware_bridge.emulate kobuki --link PATH`, `lidar --link PATH` or `boards --links DIR`;
runs until stopped.
"""

import argparse
import math
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point, Pose, wrap
from actors.instant import START, Duration, Instant, in_seconds
from actors.portable import arrays, cos, sin
from actors.radio.radio_model import RadioSetup
from actors.randomness import generator
from actors.runtime.command_line import ArgumentParser
from actors.runtime.errors import AcrcError
from actors.world.odometry import KobukiErrors
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick.air import EmulatedAir, State, air
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.kobuki.base import EXACT, BaseParameters, BodyTruth, EmulatedKobuki
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, EmulatedRplidarParameters


@dataclass(frozen=True)
class Room:
    """A rectangle with a corner at the origin; x along its width, y along its depth."""

    width: float = 6.0
    """m."""
    depth: float = 4.0
    """m."""

    @property
    def middle(self) -> Point:
        """Its middle."""
        return Point(self.width / 2, self.depth / 2)

    def ranges(self, sensor: Pose, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of the wall from a sensor within, in each direction of the sensor's own frame: (n,), m."""
        c, s = arrays.cos(sensor.heading + angles), arrays.sin(sensor.heading + angles)
        with np.errstate(divide="ignore"):
            along_x = np.where(c > 0, self.width - sensor.x, -sensor.x) / c
            along_y = np.where(s > 0, self.depth - sensor.y, -sensor.y) / s
        nearest: NDArray[np.float64] = np.minimum(
            np.where(c == 0, np.inf, along_x), np.where(s == 0, np.inf, along_y)
        )
        return nearest

    def touched(self, point: Point, radius: float) -> list[float]:
        """Directions of the walls that a disc of `radius` touches, rad."""
        gaps = {
            0.0: self.width - radius - point.x,
            math.pi / 2: self.depth - radius - point.y,
            math.pi: point.x - radius,
            -math.pi / 2: point.y - radius,
        }
        return [direction for direction, gap in gaps.items() if gap < 1e-6]

    def held(self, point: Point, radius: float) -> Point:
        """The nearest point at which a disc of `radius` fits in."""
        return Point(
            min(max(point.x, radius), self.width - radius), min(max(point.y, radius), self.depth - radius)
        )


EMPTY: Final = Room()
"""As large as an office."""


_SUBSTEP_US = 5_000


class Unicycle:
    """A disc that does at once what its wheels do, and stops at the walls of a room."""

    def __init__(
        self,
        pose: Pose | None = None,
        room: Room = EMPTY,
        radius: float = 0.177,
        started: Instant = START,
    ) -> None:
        """`pose`: the middle of the room, if not given; `radius`: of a Kobuki, m."""
        self.room = room
        self._radius = radius
        self._pose = Pose(*room.middle, 0.0) if pose is None else pose
        self._now = started
        self._wanted = (0.0, 0.0)
        self._v = self._omega = 0.0
        self._bumper = 0

    def drive(self, v: float, omega: float) -> None:
        """As in Body."""
        self._wanted = (v, omega)

    def advance(self, now: Instant) -> None:
        """As in Body."""
        while self._now < now:
            step = min(_SUBSTEP_US, now - self._now)
            self._now = Instant(self._now + step)
            self._move(Duration(step))

    def truth(self) -> BodyTruth:
        """As in Body."""
        return BodyTruth(self._pose, self._v, self._omega)

    def bumper(self) -> int:
        """As in Body."""
        return self._bumper

    def _move(self, step: Duration) -> None:
        time = in_seconds(step)
        v, omega = self._wanted
        here, turn = self._pose, omega * time
        course = here.heading + turn / 2
        way = v * time * (sin(turn / 2) / (turn / 2) if turn else 1.0)
        aim = Point(here.x + way * cos(course), here.y + way * sin(course))
        there = self.room.held(aim, self._radius)
        self._pose = Pose(*there, wrap(here.heading + turn))
        self._v = math.copysign(here.point.distance_to(there), v) / time
        self._omega = omega
        self._bumper = 0
        for wall in self.room.touched(there, self._radius):
            self._bumper |= _sector(wrap(wall - self._pose.heading))


def _sector(bearing: float) -> int:
    """The bumper's bit towards a wall: three sectors of 60° round the front."""
    if abs(bearing) <= math.radians(30):
        return 2
    if abs(bearing) <= math.radians(90):
        return 4 if bearing > 0 else 1
    return 0


_ROUND_S: Final = 0.001
"""Longest wait for bytes, s: as fine as the emulated devices' own timing."""
_MOST: Final = 100
_PROGRAM: Final = "python -m firmware_bridge.emulate"


class EmulatedDevice(Protocol):
    """A device without I/O."""

    def take(self, now: Instant, data: bytes) -> None:
        """Bytes from the driver, that end `now`."""

    def run(self, now: Instant) -> bytes:
        """Let time pass until `now`; the bytes that have left for the driver."""


def serve(
    devices: Sequence[EmulatedDevice],
    links: Sequence[Path],
    what: str,
    advance: Callable[[Instant], None] = lambda now: None,
) -> None:
    """Be these devices at these paths until SIGTERM or SIGINT; `what` they are is said. Raises AcrcError.

    `advance`: lets what lies between them happen until an instant.
    """
    stopped = False

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    with ExitStack() as stack:
        for number in (signal.SIGTERM, signal.SIGINT):
            stack.callback(signal.signal, number, signal.signal(number, stop))
        lines = [stack.enter_context(PseudoTerminal(link)) for link in links]
        sys.stdout.write(f"{what} at {', '.join(map(str, links))}; stop with Ctrl+C\n")
        sys.stdout.flush()
        begun = time.monotonic_ns()
        while not stopped:
            time.sleep(_ROUND_S)
            now = Instant((time.monotonic_ns() - begun) // 1000)
            advance(now)
            for device, line in zip(devices, lines, strict=True):
                if data := line.read(0.0):
                    device.take(now, data)
                line.write(device.run(now))


def boards(count: int, spacing: float = 2.0, seed: int = 1) -> EmulatedAir:
    """So many boards with the addresses 1, 2, … in a row, `spacing` m apart, and nothing between them."""
    addresses = tuple((f"board{number}", number) for number in range(1, count + 1))
    where = air(RadioSetup(seed, SUBSTEP, addresses, "beeclick"))
    for _ in addresses:
        where.add(EmulatedBoard(where, START))
    where.place(START, [standing(number * spacing, 0.0) for number in range(count)])
    return where


def standing(x: float, y: float) -> State:
    """The state of what stands there, m."""
    return (x, y, 0.0, 0.0, 0.0, 0.0)


def main(argv: Sequence[str]) -> int:
    """Be what the command line says; the exit code."""
    try:
        options = _parser().parse_args(argv)
        options.begin(options)
    except (AcrcError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _parser() -> ArgumentParser:
    parser = ArgumentParser(prog=_PROGRAM, description="Emulates devices in an empty room.")
    kinds = parser.add_subparsers(required=True, metavar="DEVICE", parser_class=ArgumentParser)
    kobuki = kinds.add_parser("kobuki", help="a base in the middle of the room")
    kobuki.set_defaults(begin=_kobuki)
    kobuki.add_argument("--noisy", action="store_true", help="encoders and gyro err as real ones do")
    lidar = kinds.add_parser("lidar", help="an RPLIDAR A1 in the middle of the room")
    lidar.set_defaults(begin=_lidar)
    several = kinds.add_parser("boards", help="BEE-click boards that hear one another")
    several.set_defaults(begin=_boards)
    several.add_argument("--links", type=Path, required=True, metavar="DIR", help="for board1, board2, …")
    several.add_argument("--boards", type=int, default=2, metavar="N", help="1 to 100  [default: 2]")
    several.add_argument("--spacing", type=float, default=2.0, metavar="M", help="between two  [default: 2]")
    for one in (kobuki, lidar):
        one.add_argument("--link", type=Path, required=True, metavar="PATH", help="to the pseudo-terminal")
    for one in (kobuki, several):
        one.add_argument("--seed", type=int, default=1, metavar="N", help="of what is random  [default: 1]")
    return parser


def _kobuki(options: argparse.Namespace) -> None:
    if options.seed < 0:
        raise AcrcError(
            f"{_PROGRAM} kobuki: argument --seed: {options.seed} is negative; it should be 0 or more"
        )
    parameters = BaseParameters(errors=KobukiErrors() if options.noisy else EXACT)
    base = EmulatedKobuki(Unicycle(), generator(options.seed, "kobuki", "emulated"), parameters)
    serve([base], [options.link], "a Kobuki")


def _lidar(options: argparse.Namespace) -> None:
    here = Pose(*EMPTY.middle, 0.0)
    parameters = EmulatedRplidarParameters(noise=0.0025)
    noise = generator(0, "laboratory lidar", "")
    lidar = EmulatedRplidar(lambda angles: EMPTY.ranges(here, angles), parameters, generator=noise)
    serve([lidar], [options.link], "an RPLIDAR A1")


def _boards(options: argparse.Namespace) -> None:
    if not 1 <= options.boards <= _MOST:
        raise AcrcError(f"There cannot be {options.boards} boards; it must be 1 to {_MOST}.")
    options.links.mkdir(parents=True, exist_ok=True)
    where = boards(options.boards, options.spacing, options.seed)
    links = [options.links / f"board{number}" for number in range(1, options.boards + 1)]
    serve(where.devices, links, "boards", where.advance)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
