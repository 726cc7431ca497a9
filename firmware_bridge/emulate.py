"""Emulated devices on pseudo-terminals, in real time: `python -m firmware_bridge.emulate kobuki --link PATH`.

Or `lidar --link PATH`, or `boards --boards 3 --links DIR`; until they are told to stop.
"""

import argparse
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Final, Protocol

from actors.geometry import Pose
from actors.instant import START, Instant
from actors.radio.radio_setup import RadioSetup
from actors.randomness import generator
from actors.runtime.command_line import ArgumentParser
from actors.runtime.errors import AcrcError
from actors.world.odometry import KobukiErrors
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick.emulation.air import EmulatedAir, State, air
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.kobuki.base import EXACT, BaseParameters, EmulatedKobuki
from firmware_bridge.kobuki.body import Unicycle
from firmware_bridge.pseudo_terminal import PseudoTerminal
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, EmulatedRplidarParameters
from firmware_bridge.room import EMPTY

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
