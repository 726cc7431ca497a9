"""`python -m firmware_bridge.laboratory --setup FILE --links DIR --result FILE`: until told to stop.

Each robot's devices are at DIR/<robot>/base, radio and range; "ready" on standard output says that they are.
"""

import os
import select
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Final

import msgspec

from actors.instant import Duration, Instant, in_seconds, seconds
from actors.runtime.errors import AcrcError
from actors.runtime.parent import die_with_parent
from actors.runtime.seat import ArgumentParser
from firmware_bridge.laboratory.laboratory import DEVICES, Laboratory
from firmware_bridge.laboratory.setup import LaboratoryResult, LaboratorySetup
from firmware_bridge.pseudo_terminal import PseudoTerminal

_ROUND_S: Final = 0.002
"""Longest wait for bytes: as the emulated devices alone have it."""
_MOST_BEHIND: Final[Duration] = seconds(0.5)
"""More than this is not made up, for then nobody would be served meanwhile; it is left out and counted."""


class Room:
    """A laboratory with its pseudo-terminals, against the clock."""

    def __init__(self, laboratory: Laboratory, links: Path, stack: ExitStack) -> None:
        self._laboratory = laboratory
        self._lines: dict[tuple[str, str], PseudoTerminal] = {}
        for robot in dict.fromkeys(robot for robot, _ in laboratory.devices):
            (links / robot).mkdir(parents=True, exist_ok=True)
            for device in DEVICES:
                line = PseudoTerminal(links / robot / device)
                self._lines[robot, device] = stack.enter_context(line)
        self._behind: Counter[int] = Counter()
        self._left_out = 0
        self._began_ns = time.monotonic_ns()
        self._began_us = time.time_ns() // 1000

    def serve(self) -> None:
        """Wait a little for bytes, then let as much time pass as has passed."""
        by_number = {line.fileno(): key for key, line in self._lines.items()}
        ready, _, _ = select.select(list(by_number), [], [], _ROUND_S)
        for number in ready:
            key = by_number[number]
            if data := self._lines[key].read(0.0):
                self._laboratory.devices[key].take(self._laboratory.now, data)
        now = self._now()
        late = now - self._laboratory.now
        self._behind[min(late // 1000, 1000)] += 1
        if late > _MOST_BEHIND:
            self._left_out += late - _MOST_BEHIND
            now = Instant(now - (late - _MOST_BEHIND))
        self._laboratory.advance(now, self._send)

    def result(self) -> LaboratoryResult:
        """What has happened so far."""
        laboratory = self._laboratory
        return LaboratoryResult(
            began_us=self._began_us,
            simulated_s=in_seconds(laboratory.now),
            contacts=laboratory.contacts,
            places=laboratory.referee.outcomes({}),
            lines={f"{robot} {device}": line.lost for (robot, device), line in self._lines.items()},
            boards=laboratory.boards,
            behind_ms={str(late): count for late, count in sorted(self._behind.items())},
            lost_ms=self._left_out // 1000,
        )

    def _send(self, robot: str, device: str, data: bytes) -> None:
        self._lines[robot, device].write(data)

    def _now(self) -> Instant:
        return Instant((time.monotonic_ns() - self._began_ns) // 1000 - self._left_out)


def main(argv: Sequence[str]) -> int:
    """Play the hardware until told to stop; the exit code."""
    stopped: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped.append(number)

    try:
        parser = ArgumentParser(prog="python -m firmware_bridge.laboratory", description="Plays hardware.")
        parser.add_argument("--setup", required=True, type=Path, help="JSON file with the set-up")
        parser.add_argument("--links", required=True, type=Path, help="folder for the devices' ports")
        parser.add_argument("--result", required=True, type=Path, help="JSON file to write at the end")
        parser.add_argument("--with-parent", action="store_true", help="end when the starting process ends")
        options = parser.parse_args(argv)
        if options.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        setup = _load(options.setup)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        with ExitStack() as stack:
            room = Room(Laboratory(setup), options.links, stack)
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            while not stopped:
                room.serve()
            options.result.write_bytes(msgspec.json.format(msgspec.json.encode(room.result())))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


def _load(path: Path) -> LaboratorySetup:
    try:
        return msgspec.json.decode(path.read_bytes(), type=LaboratorySetup)
    except (OSError, msgspec.DecodeError) as error:
        raise AcrcError(f"{path}: no set-up of a laboratory: {error}") from None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
