"""An emulated RPLIDAR A1: `python -m firmware_bridge.range_sensors.emulate --link PATH`."""

import sys
from collections.abc import Sequence

from actors.geometry import Pose
from actors.randomness import generator
from actors.runtime.errors import AcrcError
from firmware_bridge.emulation import link_parser, serve
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, EmulatedRplidarParameters
from firmware_bridge.room import EMPTY


def main(argv: Sequence[str]) -> int:
    """Be a lidar in the middle of an empty room until told to stop; the exit code."""
    parser = link_parser("python -m firmware_bridge.range_sensors.emulate", "A lidar in an empty room.")
    here = Pose(*EMPTY.middle, 0.0)
    try:
        options = parser.parse_args(argv)
        lidar = EmulatedRplidar(
            lambda angles: EMPTY.ranges(here, angles),
            EmulatedRplidarParameters(noise=0.0025),
            generator=generator(0, "laboratory lidar", ""),
        )
        serve(lidar, options.link, "an RPLIDAR A1")
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
