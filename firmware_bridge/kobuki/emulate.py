"""An emulated Kobuki: `python -m firmware_bridge.kobuki.emulate --link PATH [--seed N] [--noisy]`."""

import sys
from collections.abc import Sequence

from actors.randomness import generator
from actors.runtime.errors import AcrcError
from actors.world.odometry import KobukiErrors
from firmware_bridge.emulation import link_parser, serve
from firmware_bridge.kobuki.base import EXACT, BaseParameters, EmulatedKobuki
from firmware_bridge.kobuki.body import Unicycle


def main(argv: Sequence[str]) -> int:
    """Be a Kobuki in the middle of an empty room until told to stop; the exit code."""
    parser = link_parser("python -m firmware_bridge.kobuki.emulate", "A Kobuki in an empty room.")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the errors of its sensors")
    parser.add_argument("--noisy", action="store_true", help="encoders and gyro err as real ones do")
    try:
        options = parser.parse_args(argv)
        if options.seed < 0:
            parser.error(f"argument --seed: {options.seed} is negative; it should be 0 or more")
        parameters = BaseParameters(errors=KobukiErrors() if options.noisy else EXACT)
        base = EmulatedKobuki(Unicycle(), generator(options.seed, "kobuki", "emulated"), parameters)
        serve(base, options.link, "a Kobuki")
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
