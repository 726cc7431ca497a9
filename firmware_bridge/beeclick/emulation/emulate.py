"""Emulated boards: `python -m firmware_bridge.beeclick.emulation.emulate --boards 3 --links DIR`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from actors.instant import START
from actors.runtime.client_options import ArgumentError, ArgumentParser
from actors.runtime.errors import AcrcError
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulation.emulated_medium import EmulatedMedium, MediumParameters, Place
from firmware_bridge.beeclick.emulation.pty import serve

_MOST = 100


def main(argv: Sequence[str]) -> int:
    """Run the boards; the exit code."""
    try:
        options = _parse(argv)
        options.links.mkdir(parents=True, exist_ok=True)
        links = [options.links / f"board{number}" for number in range(1, options.boards + 1)]
        serve(room(options.boards, options.spacing, options.loss, options.seed), links)
    except (AcrcError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def room(boards: int, spacing: float, loss: float, seed: int) -> EmulatedMedium:
    """So many boards in a row, `spacing` m apart."""
    medium = EmulatedMedium(np.random.default_rng(seed), MediumParameters(loss=loss))
    for number in range(boards):
        medium.add(EmulatedBoard(medium, START), standing(number * spacing, 0.0))
    return medium


def standing(x: float, y: float) -> Place:
    """A place that stays where it is, m."""
    return lambda _: (x, y)


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
    parser.add_argument(
        "--loss", type=float, default=0.0, metavar="P", help="share of frames lost at random  [default: 0]"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of what is random  [default: 1]")
    options = parser.parse_args(argv)
    if not 1 <= options.boards <= _MOST:
        raise ArgumentError(f"There cannot be {options.boards} boards; it must be 1 to {_MOST}.")
    if not 0.0 <= options.loss <= 1.0:
        raise ArgumentError(f"A share of {options.loss:g} of the frames cannot be lost; it must be 0 to 1.")
    return options


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
