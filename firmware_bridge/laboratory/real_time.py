"""A laboratory against the clock: one loop that waits for bytes, and lets time pass as it has passed."""

import os
import select
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from actors.instant import START, Duration, Instant, in_seconds, milliseconds
from actors.runtime.errors import AcrcError
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.parameters import FIRST_CHANNEL
from firmware_bridge.kobuki.base import EmulatedKobuki
from firmware_bridge.laboratory.faults import Bench
from firmware_bridge.laboratory.laboratory import Laboratory
from firmware_bridge.laboratory.laboratory_setup import LaboratoryResult, LaboratoryTruth
from firmware_bridge.laboratory.lines import Lines
from firmware_bridge.transceiver_line import SimulatedTransceiver

_ROUND: Final = milliseconds(1)
"""Boards are not looked at more often, unless a host has written."""
_MOST_BEHIND: Final = 50
"""Sub-steps; more are not made up, for then no line would be served meanwhile. They are left out."""
_LONGEST_LINE: Final = 4096


class InputLines:
    """Lines of text from a descriptor, as they come."""

    def __init__(self, descriptor: int | None) -> None:
        """`descriptor`: where to read; None: nobody says anything."""
        self.descriptor = descriptor
        """None once it has ended."""
        self._pending = b""

    def read(self) -> list[str]:
        """The lines that have ended; to be called when the descriptor is readable."""
        if self.descriptor is None:
            return []
        try:
            data = os.read(self.descriptor, _LONGEST_LINE)
        except OSError:
            data = b""
        if not data:
            self.descriptor = None
        *lines, self._pending = (self._pending + data).split(b"\n")
        self._pending = self._pending[:_LONGEST_LINE]
        return [line.decode(errors="replace") for line in lines]


class RealTime:
    """The loop, with what it has to say about itself."""

    def __init__(
        self, laboratory: Laboratory, lines: Lines, wishes: InputLines, duration: Duration | None = None
    ) -> None:
        """The laboratory's time begins now; it ends at `duration`, or is ended."""
        self._laboratory = laboratory
        self._lines = lines
        self._wishes = wishes
        self._duration = duration
        self._bench = Bench(laboratory, lines)
        self._behind: Counter[int] = Counter()
        self._left_out = 0
        self._began_us = time.time_ns() // 1000
        self._began_cpu_s = time.process_time()
        self._began_ns = time.monotonic_ns()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped`, or to the end of its time."""
        while not stopped() and (self._duration is None or self._laboratory.instant < self._duration):
            self.serve()

    def serve(self) -> None:
        """Wait for the next sub-step, a board that has something to do, bytes or a wish; and do it all."""
        by_number = self._lines.descriptors
        numbers = [*by_number]
        if self._wishes.descriptor is not None:
            numbers.append(self._wishes.descriptor)
        ready, _, _ = select.select(numbers, [], [], self._patience())
        now = self._catch_up()
        for number in ready:
            if number in by_number:
                jack = by_number[number]
                if data := self._lines.read(jack):
                    self._laboratory.take(jack, now, data)
        if self._wishes.descriptor in ready:
            for line in self._wishes.read():
                self._answer(line)

    def result(self) -> LaboratoryResult:
        """What has happened so far."""
        laboratory = self._laboratory
        return LaboratoryResult(
            began_us=self._began_us,
            simulated_s=in_seconds(Duration(laboratory.now - START)),
            contacts=laboratory.contacts,
            places=laboratory.places,
            lines={" ".join(jack): self._lines.unread(jack) for jack in self._lines.jacks},
            boards={robot: _board(hardware.radio) for robot, hardware in laboratory.robots.items()},
            behind_ms={str(late): count for late, count in sorted(self._behind.items())},
            lost_ms=self._left_out // 1000,
            robots={
                robot: LaboratoryTruth(laboratory.pose(robot), laboratory.travelled(robot))
                for robot in laboratory.robots
            },
            bases={robot: _base(hardware.base) for robot, hardware in laboratory.robots.items()},
            frames=laboratory.air.counters(),
            frames_by_robot=laboratory.air.counters_by_robot(list(laboratory.robots)),
            cpu_s=time.process_time() - self._began_cpu_s,
        )

    def _patience(self) -> float:
        """How long to wait for bytes, s."""
        now = self._clock()
        wake = min(self._laboratory.now + SUBSTEP, max(self._laboratory.wake, now + _ROUND))
        return max(0, wake - now) * 1e-6

    def _catch_up(self) -> Instant:
        """What time it is, once every sub-step until then has been made or left out."""
        now = self._clock()
        most = self._laboratory.now + _MOST_BEHIND * SUBSTEP
        if now > most:
            self._left_out += now - most
            sys.stderr.write(
                f"{(now - self._laboratory.now) // 1000} ms behind; {(now - most) // 1000} ms are left out\n"
            )
            sys.stderr.flush()
            now = Instant(most)
        if self._duration is not None:
            now = min(now, Instant(self._duration))
        for due in range(self._laboratory.now + SUBSTEP, now + 1, SUBSTEP):
            self._behind[(now - due) // 1000] += 1
        self._laboratory.advance(now, self._lines.send)
        return now

    def _answer(self, line: str) -> None:
        try:
            answer = self._bench.do(line)
        except AcrcError as error:
            answer = str(error)
        with suppress(BrokenPipeError):  # whoever asked has gone
            sys.stdout.write(f"{answer}\n")
            sys.stdout.flush()

    def _clock(self) -> Instant:
        return Instant((time.monotonic_ns() - self._began_ns) // 1000 - self._left_out)


def _board(radio: EmulatedBoard | SimulatedTransceiver) -> dict[str, int]:
    counters = radio.counters if isinstance(radio, EmulatedBoard) else {}
    return {**counters, "address": radio.address, "channel": radio.channel + FIRST_CHANNEL}


def _base(base: EmulatedKobuki) -> dict[str, int]:
    return {"frames": base.reception.frames, "skipped": base.reception.skipped}
