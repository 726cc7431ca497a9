"""Range sensor of a ROS 2 robot: conversion of LaserScan messages (REP 117) to sweeps and scans."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from actors.array_types import Flags, Floats
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.robot_model import RangeSensor
from firmware_bridge.range_sensors.rplidar import FEWEST, MOST
from firmware_bridge.range_sensors.sensor import (
    MIN_ECHOES,
    SECTORS,
    RangeReader,
    SensorSweep,
    chosen_samples,
)
from firmware_bridge.ros2.message_types import SCAN, InvalidMessageError
from firmware_bridge.ros2.robot_clock import RobotClock
from firmware_bridge.ros2.session import ReceivedSample
from firmware_bridge.serial_port import Say, changed_only

_TIMEOUT_PERIODS: Final = 1.5
_JITTER: Final = milliseconds(50)
"""Timeout of scans: that many periods of the model's sensor and this time. Own choice."""
_MAX_GAP: Final = math.radians(10)
"""Maximum angle between valid readings, rad; own choice, as for an RPLIDAR."""
_MAX_TURN: Final = math.tau + 0.1
_ANGLE_TOLERANCE: Final = 2.0
"""Maximum difference of `angle_max` from the last reading's angle, in increments: drivers differ by one."""
_CHECKED: Final = 480
"""Maximum number of readings for the checks of contradictions, whose duration grows with it; own choice."""
_MAX_DURATION: Final = 1.0
"""Maximum duration of a scan, s."""


@dataclass
class ScanCounts:
    """Counts of messages by outcome."""

    scans: int = 0
    invalid: int = 0
    """Not a LaserScan, or with contradictory fields."""
    thin: int = 0
    """With too many errors among the readings."""
    blind: int = 0
    """Without echo."""


class LaserScanReader(RangeReader):
    """Reader of one robot's scans."""

    def __init__(self, model: RangeSensor, say: Say) -> None:
        super().__init__(model)
        self._model, self._say = model, changed_only(say)
        self.timeout = Duration(round(_TIMEOUT_PERIODS * model.period) + _JITTER)
        """Maximum time between two scans."""
        self.clock = RobotClock()
        self.counts = ScanCounts()
        self._echo_at: Instant | None = None
        """Time of the last scan; None if it had no echo."""

    def is_measuring(self, now: Instant) -> bool:
        """Return whether scans with echoes arrive."""
        return self._echo_at is not None and now - self._echo_at <= self.timeout

    def take(self, samples: Sequence[ReceivedSample]) -> None:
        """Process messages."""
        for sample in samples:
            try:
                self._read(sample.arrived, sample.message(SCAN))
            except InvalidMessageError as error:
                self.counts.invalid += 1
                self._say(f"scan refused: {error}")

    def _read(self, arrived: Instant, message: Any) -> None:
        ranges: Floats = message.ranges.astype(np.float64)
        angles = _angles(message)
        time = self._duration(message)
        end = self.clock.convert(arrived, message.header, time)
        self._say("scan: late, or the clock of its computer was set back" if self.clock.is_late else "")
        if end is None:
            return
        ranges = np.where(ranges > message.range_max, np.inf, ranges)
        near = max(self._model.range_min, 0.002) / 2  # too near: no echo, but occludes others
        ranges = np.where(np.isneginf(ranges), near, ranges)
        valid = ~np.isnan(ranges)
        if not self._is_dense(angles[valid]):
            self.counts.thin += 1
            return
        stamps = end.instant - time + np.arange(ranges.size) * time // max(1, ranges.size - 1)
        sweep = SensorSweep(stamps[valid], angles[valid], np.where(ranges > 0, ranges, np.inf)[valid])
        echo = np.isfinite(sweep.ranges)
        if not echo.any():
            self.counts.blind += 1
            self._echo_at = None
            return
        self.counts.scans += 1
        self._echo_at = end.instant
        self._compare(sweep, echo)
        self.store_sweep(Instant(end.instant - time // 2), sweep)
        every = slice(None, None, -(-echo.size // _CHECKED))
        self._sweep = chosen_samples(sweep, every)

    def _duration(self, message: Any) -> Duration:
        """Return the time from the first to the last reading."""
        for time in (message.time_increment * (message.ranges.size - 1), message.scan_time):
            if 0 < time <= _MAX_DURATION:
                return seconds(time)
        return self._model.period

    def _is_dense(self, angles: Floats) -> bool:
        """Return whether there are valid readings in all directions of the model's view."""
        if angles.size < FEWEST:
            return False
        around = np.sort(np.remainder(angles, math.tau))
        gaps = np.diff(around, append=around[0] + math.tau)
        blind = math.tau - math.radians(self._model.field_of_view_deg)
        return bool(np.sort(gaps)[-1] <= max(blind, 0.0) + _MAX_GAP and np.sort(gaps)[-2] <= _MAX_GAP)

    def _compare(self, sweep: SensorSweep, echo: Flags) -> None:
        """Compare the parts of the scan with those of earlier ones."""
        for part, has_echo in zip(
            np.array_split(sweep.ranges, SECTORS), np.array_split(echo, SECTORS), strict=True
        ):
            if np.count_nonzero(has_echo) >= MIN_ECHOES:
                self._repeats.take(part.tobytes())
        distances = np.where(echo, np.minimum(sweep.ranges, 1e5) * 4000, 0.0)
        self._still.take(sweep.angles, distances.astype(np.int64))


def _angles(message: Any) -> Floats:
    """Return the directions of the readings. Raises InvalidMessageError."""
    first, step, last = (
        float(one) for one in (message.angle_min, message.angle_increment, message.angle_max)
    )
    count = message.ranges.size
    if not FEWEST <= count <= MOST:
        raise InvalidMessageError(f"{count} readings, must have {FEWEST} to {MOST}; check the lidar's driver")
    turn = step * (count - 1)
    if not (math.isfinite(first) and abs(first) <= math.tau and 0 < abs(turn) <= _MAX_TURN):
        raise InvalidMessageError(f"{count} readings from {first:g} rad with increment {step:g} rad")
    if not abs(first + turn - last) <= _ANGLE_TOLERANCE * abs(step):
        raise InvalidMessageError(
            f"angle_max is {last:g} rad, but {count} readings end at {first + turn:.3f} rad; check the "
            "lidar's driver"
        )
    return first + step * np.arange(count, dtype=np.float64)
