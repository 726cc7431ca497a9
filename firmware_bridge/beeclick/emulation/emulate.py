"""Emulated boards: `python -m firmware_bridge.beeclick.emulation.emulate --boards 3 --links DIR`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from actors.instant import START
from actors.radio.radio_setup import RadioSetup
from actors.runtime.command_line import ArgumentError, ArgumentParser
from actors.runtime.errors import AcrcError
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick.emulation.air import EmulatedAir, State, air
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulation.pty import serve

_MOST = 100


def main(argv: Sequence[str]) -> int:
    """Run the boards; the exit code."""
    try:
        options = _parse(argv)
        options.links.mkdir(parents=True, exist_ok=True)
        links = [options.links / f"board{number}" for number in range(1, options.boards + 1)]
        serve(room(options.boards, options.spacing, options.seed), links)
    except (AcrcError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def room(boards: int, spacing: float = 2.0, seed: int = 1) -> EmulatedAir:
    """So many boards with the addresses 1, 2, … in a row, `spacing` m apart, and nothing between them."""
    addresses = tuple((f"board{number}", number) for number in range(1, boards + 1))
    where = air(RadioSetup(seed, SUBSTEP, addresses, "beeclick"))
    for _ in addresses:
        where.add(EmulatedBoard(where, START))
    where.place(START, [standing(number * spacing, 0.0) for number in range(boards)])
    return where


def standing(x: float, y: float) -> State:
    """The state of what stands there, m."""
    return (x, y, 0.0, 0.0, 0.0, 0.0)


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="python -m firmware_bridge.beeclick.emulation.emulate",
        description="Emulates BEE-click boards that hear one another, on pseudo-terminals.",
    )
    parser.add_argument("--boards", type=int, default=2, metavar="N", help="how many, 1 to 100  [default: 2]")
    parser.add_argument(
        "--links", type=Path, required=True, metavar="DIR", help="where to put the links board1, board2, …"
    )
    parser.add_argument(
        "--spacing",
        type=float,
        default=2.0,
        metavar="M",
        help="they stand in a row, so far apart  [default: 2]",
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of what is random  [default: 1]")
    options = parser.parse_args(argv)
    if not 1 <= options.boards <= _MOST:
        raise ArgumentError(f"There cannot be {options.boards} boards; it must be 1 to {_MOST}.")
    return options


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
