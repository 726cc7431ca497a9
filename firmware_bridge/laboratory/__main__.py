"""`python -m firmware_bridge.laboratory --setup FILE --links DIR --result FILE`: until told to stop.

Each robot's devices are at DIR/<robot>/base, radio and range; "ready" on standard output says that they are.
Each line on standard input lets something go wrong (`unplug r2 radio`; laboratory.faults knows what else) and
is answered by a line: "ok", or what was asked (`where r2`), or what is wrong with it.
"""

import gc
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Final

import msgspec

from actors.instant import seconds
from actors.radio.program import KERNELS as RADIO_KERNELS
from actors.randomness import generator
from actors.runtime.command_line import ArgumentError, ArgumentParser
from actors.runtime.errors import AcrcError
from actors.runtime.fingerprint import fingerprints
from actors.runtime.lifecycle.parent import die_with_parent
from actors.task import visits
from actors.world import drive, odometry_kernel, rays
from firmware_bridge.laboratory.laboratory import DEVICES, Jack, Laboratory
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup, load
from firmware_bridge.laboratory.lines import Lines
from firmware_bridge.laboratory.real_time import InputLines, RealTime

_KERNELS: Final = (odometry_kernel, drive, rays, visits, *RADIO_KERNELS)


def main(argv: Sequence[str]) -> int:
    """Play the hardware until told to stop; the exit code."""
    stopped: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped.append(number)

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        parser = ArgumentParser(prog="python -m firmware_bridge.laboratory", description="Plays hardware.")
        parser.add_argument("--setup", required=True, type=Path, help="JSON file with the set-up")
        parser.add_argument("--links", required=True, type=Path, help="folder for the devices' ports")
        parser.add_argument("--result", required=True, type=Path, help="JSON file to write at the end")
        parser.add_argument("--duration", type=float, help="end after so many seconds  [default: when told]")
        parser.add_argument("--with-parent", action="store_true", help="end when the starting process ends")
        options = parser.parse_args(argv)
        if options.duration is not None and not 0 <= options.duration <= 1e6:
            raise ArgumentError(f"--duration is {options.duration:g} s; it should be 0 to a million")
        if options.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        laboratory, lines = _build(load(options.setup), options.links)
        duration = None if options.duration is None else seconds(options.duration)
        fingerprints(_KERNELS)  # all kernels compiled before the clock runs
        with lines:
            gc.collect()
            gc.freeze()
            loop = RealTime(laboratory, lines, InputLines(_standard_input()), duration)
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            loop.run(lambda: bool(stopped))
            _write(options.result, msgspec.json.encode(loop.result()))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _build(setup: LaboratorySetup, links: Path) -> tuple[Laboratory, Lines]:
    if not setup.world.robots:
        raise AcrcError("a laboratory without robots; there should be one at least")
    jacks = [Jack(robot.id, device) for robot in setup.world.robots for device in DEVICES]
    noise = generator(setup.world.seed, "laboratory lines", "")
    return Laboratory(setup), Lines(links, jacks, noise)


def _standard_input() -> int | None:
    """Its descriptor, if there is one."""
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except (OSError, ValueError):  # a test's, or closed
        return None


def _write(path: Path, result: bytes) -> None:
    try:
        path.write_bytes(msgspec.json.format(result))
    except OSError as error:
        raise AcrcError(f"{path}: cannot be written ({error.strerror}); give another file") from None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
