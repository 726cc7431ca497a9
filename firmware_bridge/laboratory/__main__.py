"""Laboratory process: `python -m firmware_bridge.laboratory --setup FILE --links DIR --result FILE`.

Runs until stopped. Each robot's devices are at DIR/<robot>/base, radio and range; after creating them it
prints "ready". Each line on standard input injects a fault (`unplug r2 radio`; see
`laboratory.FaultInjector`) and is answered by one line: "ok", the answer to a query (`where r2`), or an
error.
"""

import gc
import os
import select
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from actors.instant import START, Duration, Instant, in_seconds, milliseconds, seconds
from actors.radio.program import KERNELS as RADIO_KERNELS
from actors.randomness import generator
from actors.runtime.errors import AcrcError
from actors.runtime.linux import die_with_parent
from actors.runtime.process_setup import ArgumentParser
from actors.runtime.processor import fingerprints
from actors.user_code import set_task_folders
from actors.world import drive, odometry, rays
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick.answer_decoder import FIRST_CHANNEL
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.device_lines import DEVICES, DevicePort, EmulatedLines, SimulatedTransceiver
from firmware_bridge.laboratory.laboratory import (
    FaultInjector,
    Laboratory,
    LaboratoryResult,
    LaboratorySetup,
    LaboratoryTruth,
    load,
)

_BOARD_INTERVAL: Final = milliseconds(1)
"""Minimum interval of serving boards, unless a host has written."""
_MAX_LATE_SUBSTEPS: Final = 50
"""Maximum number of late sub-steps that are caught up; more are skipped, to keep serving the lines."""
_MAX_LINE_BYTES: Final = 4096


class LineReader:
    """Incremental reader of text lines from a descriptor."""

    def __init__(self, descriptor: int | None) -> None:
        """Create it; `descriptor`: input, None = no input."""
        self.descriptor = descriptor
        """None after end of file."""
        self._pending = b""

    def read(self) -> list[str]:
        """Return completed lines; call it when the descriptor is readable."""
        if self.descriptor is None:
            return []
        try:
            data = os.read(self.descriptor, _MAX_LINE_BYTES)
        except OSError:
            data = b""
        if not data:
            self.descriptor = None
        *lines, self._pending = (self._pending + data).split(b"\n")
        self._pending = self._pending[:_MAX_LINE_BYTES]
        return [line.decode(errors="replace") for line in lines]


class RealTimeLoop:
    """Real-time loop of a laboratory, with statistics."""

    def __init__(
        self,
        laboratory: Laboratory,
        lines: EmulatedLines,
        commands: LineReader,
        duration: Duration | None,
    ) -> None:
        """Start the laboratory's time now; `duration`: its end, None = until stopped."""
        self._laboratory = laboratory
        self._lines = lines
        self._commands = commands
        self._duration = duration
        self._injector = FaultInjector(laboratory, lines)
        self._late_substeps: Counter[int] = Counter()
        self._skipped_us = 0
        self._began_us = time.time_ns() // 1000
        self._began_cpu_s = time.process_time()
        self._began_ns = time.monotonic_ns()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped` or the end of its time."""
        while not stopped() and (self._duration is None or self._laboratory.instant < self._duration):
            self.serve()

    def serve(self) -> None:
        """Wait for the next sub-step, a board's action, bytes or a command, and process them."""
        ports = self._lines.descriptors
        descriptors = [*ports]
        if self._commands.descriptor is not None:
            descriptors.append(self._commands.descriptor)
        now = self._clock()
        wake = min(self._laboratory.now + SUBSTEP, max(self._laboratory.wake, now + _BOARD_INTERVAL))
        ready, _, _ = select.select(descriptors, [], [], max(0, wake - now) * 1e-6)
        now = self._catch_up()
        for number in ready:
            if number in ports:
                port = ports[number]
                if data := self._lines.read(port):
                    self._laboratory.take(port, now, data)
        if self._commands.descriptor in ready:
            for line in self._commands.read():
                self._answer(line)

    def result(self) -> LaboratoryResult:
        """Return the result so far."""
        laboratory = self._laboratory
        return LaboratoryResult(
            began_us=self._began_us,
            simulated_s=in_seconds(Duration(laboratory.now - START)),
            contacts=laboratory.contacts,
            lines={" ".join(port): self._lines.unread(port) for port in self._lines.ports},
            boards={robot: _board(hardware.radio) for robot, hardware in laboratory.robots.items()},
            behind_ms={str(late): count for late, count in sorted(self._late_substeps.items())},
            lost_ms=self._skipped_us // 1000,
            robots={
                robot: LaboratoryTruth(laboratory.pose(robot), laboratory.travelled(robot))
                for robot in laboratory.robots
            },
            bases={
                robot: {"frames": one.base.reception.frames, "skipped": one.base.reception.skipped}
                for robot, one in laboratory.robots.items()
            },
            positions=laboratory.positions,
            frames=laboratory.medium.counters(),
            frames_by_robot=laboratory.medium.counters_by_robot(list(laboratory.robots)),
            cpu_s=time.process_time() - self._began_cpu_s,
        )

    def _catch_up(self) -> Instant:
        """Simulate or skip all sub-steps up to now; return the time."""
        now = self._clock()
        latest = self._laboratory.now + _MAX_LATE_SUBSTEPS * SUBSTEP
        if now > latest:
            self._skipped_us += now - latest
            sys.stderr.write(
                f"{(now - self._laboratory.now) // 1000} ms behind; {(now - latest) // 1000} ms skipped\n"
            )
            now = Instant(latest)
        if self._duration is not None:
            now = min(now, Instant(self._duration))
        for due in range(self._laboratory.now + SUBSTEP, now + 1, SUBSTEP):
            self._late_substeps[(now - due) // 1000] += 1
        self._laboratory.advance(now, self._lines.send)
        return now

    def _answer(self, line: str) -> None:
        try:
            answer = self._injector.execute(line)
        except AcrcError as error:
            answer = str(error)
        with suppress(BrokenPipeError):  # the client has exited
            sys.stdout.write(f"{answer}\n")
            sys.stdout.flush()

    def _clock(self) -> Instant:
        return Instant((time.monotonic_ns() - self._began_ns) // 1000 - self._skipped_us)


def _board(radio: EmulatedBoard | SimulatedTransceiver) -> dict[str, int]:
    counters = radio.counters if isinstance(radio, EmulatedBoard) else {}
    return {**counters, "address": radio.address, "channel": radio.channel + FIRST_CHANNEL}


_KERNELS: Final = (odometry, drive, rays, *RADIO_KERNELS)


def main(argv: Sequence[str]) -> int:
    """Emulate the hardware until stopped; return the exit code."""
    stopped: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: stopped.append(number))
        for number in (signal.SIGTERM, signal.SIGINT)
    }
    try:
        parser = ArgumentParser(prog="python -m firmware_bridge.laboratory", description="Emulate hardware.")
        parser.add_argument("--setup", required=True, type=Path, help="JSON file with the set-up")
        parser.add_argument("--links", required=True, type=Path, help="folder of the devices' ports")
        parser.add_argument("--result", required=True, type=Path, help="JSON file for the result")
        parser.add_argument("--duration", type=float, help="duration, s  [default: until a signal]")
        parser.add_argument("--with-parent", action="store_true", help="exit with the parent process")
        options = parser.parse_args(argv)
        if options.duration is not None and not 0 <= options.duration <= 1e6:
            raise AcrcError(f"--duration: {options.duration:g} s; must be from 0 to 1 000 000")
        if options.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        laboratory, lines = _build(load(options.setup), options.links)
        duration = None if options.duration is None else seconds(options.duration)
        fingerprints(_KERNELS)  # compile all kernels before the clock starts
        with lines:
            gc.collect()
            gc.freeze()
            loop = RealTimeLoop(laboratory, lines, LineReader(_standard_input()), duration)
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            loop.run(lambda: bool(stopped))
            _write(options.result, msgspec.json.encode(loop.result()))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _build(setup: LaboratorySetup, links: Path) -> tuple[Laboratory, EmulatedLines]:
    if not setup.world.robots:
        raise AcrcError("laboratory set-up has no robots; add at least one")
    set_task_folders([Path(folder) for folder in setup.modules])
    ports = [DevicePort(robot.id, device) for robot in setup.world.robots for device in DEVICES]
    noise = generator(setup.world.seed, "laboratory lines", "")
    return Laboratory(setup), EmulatedLines(links, ports, noise)


def _standard_input() -> int | None:
    """Return the descriptor of standard input, if any."""
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except (OSError, ValueError):  # replaced by a test, or closed
        return None


def _write(path: Path, result: bytes) -> None:
    try:
        path.write_bytes(msgspec.json.format(result))
    except OSError as error:
        raise AcrcError(f"{path}: cannot be written ({error.strerror}); choose another file") from None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
