"""Scans as the drivers of an RPLIDAR A1 and of an LDS-02 publish them, from cast rays."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

import msgspec
import numpy as np
from numpy.random import Generator

from actors.messages import NO_ECHO_MM
from actors.robot_model import RangeSensor, RobotModel

DENSE: Final = 2160
"""Cast rays per turn, of which a scan takes the nearest ones."""
SCAN_FAULTS: Final = (
    "works", "stopped", "frozen", "repeated", "mixed", "alternating", "empty", "blind", "short",
)  # fmt: skip
"""The first four are of any topic, the others of lidars."""

Fields = dict[str, Any]


def header(stamp_ns: int, frame: str) -> Fields:
    """Return a std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def dense_model(model: RobotModel) -> RobotModel:
    """Return the model with DENSE rays of its mounted sensor."""
    sensor = msgspec.structs.replace(model.sensor, rays=DENSE, field_of_view_deg=360.0)
    return msgspec.structs.replace(model, sensors={**model.sensors, model.default_sensor: sensor})


class EmulatedScanDriver(ABC):
    """Driver of a lidar."""

    no_echo: float
    """Range without an echo."""

    def __init__(self, sensor: RangeSensor, frame: str, cast: Callable[[], Any], random: Generator) -> None:
        """Create it; `cast`: returns ranges at DENSE angles of the sensor's frame, mm."""
        self._sensor, self._frame, self._cast, self._random = sensor, frame, cast, random
        self._turns = 0

    def scan(self, stamp_ns: int, state: str, mount: float) -> Fields:
        """Return the scan of a turn that ends now; `mount`: rotation from the model's mount, rad."""
        self._turns += 1
        dense = np.roll(self._cast(), -round(mount / (math.tau / DENSE)))
        return self._message(stamp_ns, state, dense)

    @abstractmethod
    def _message(self, stamp_ns: int, state: str, dense: Any) -> Fields:
        """Return the message of cast rays."""

    def _ranges(self, angles: Any, state: str, dense: Any) -> Any:
        """Return float32 ranges in m at angles of the scan's frame, rad."""
        first = math.tau / DENSE - math.pi
        millimetres = dense[np.rint((angles - first) / (math.tau / DENSE)).astype(np.int64) % DENSE]
        ranges = np.where(millimetres == NO_ECHO_MM, self.no_echo, millimetres / 1000).astype(np.float32)
        if state == "blind":
            ranges[:] = self.no_echo
        elif state == "mixed":
            draws = self._random.random(len(ranges))
            for share, value in ((0.3, np.nan), (0.2, np.inf), (0.1, 0.0), (0.05, -np.inf)):
                ranges[draws < share] = value
            ranges[draws > 0.98] = self._sensor.range_max + 50
        return ranges


class RplidarA1(EmulatedScanDriver):
    """rplidar_ros: as many equal angles as the driver has bins; no echo is infinite.

    The driver labels bins of 360°/n as steps of 359°/(n − 1), so that directions are off by up to 0.7°.
    """

    no_echo = np.inf

    def _message(self, stamp_ns: int, state: str, dense: Any) -> Fields:
        last_degree, turn = math.radians(359.0), 1 / self._sensor.rate
        count = {"empty": 0, "short": 269}.get(state, self._sensor.rays)
        if state == "alternating" and self._turns % 2:
            count = 720
        angles = math.pi - np.arange(count - 1, -1, -1) * (math.tau / max(count, 1))
        ranges = self._ranges(angles, state, dense)
        return {
            "header": header(stamp_ns - round(turn * 1e9), self._frame),  # start of the turn
            "angle_min": math.pi - last_degree,
            "angle_max": math.pi,
            "angle_increment": last_degree / max(count - 1, 1),
            "time_increment": turn / max(count - 1, 1),
            "scan_time": turn,
            "range_min": self._sensor.range_min,
            "range_max": self._sensor.range_max,
            "ranges": ranges,
            "intensities": np.where(np.isfinite(ranges), 47, 0).astype(np.float32),
        }


class Lds02(EmulatedScanDriver):
    """ld08_driver: the number of rays varies; those without a sample are NaN, those without an echo 0.

    The limits are not the sensor's; the stamp is that of the publication.
    """

    no_echo = 0.0

    def _message(self, stamp_ns: int, state: str, dense: Any) -> Fields:
        random, turn = self._random, 1 / self._sensor.rate
        count = {"empty": 0, "short": 100}.get(state, int(random.integers(452, 469)))
        if state == "alternating" and self._turns % 2:
            count = 230
        increment = math.tau / max(count, 1)
        first = float(random.random()) * increment
        ranges = self._ranges(first + np.arange(count) * increment, state, dense)
        ranges[random.random(count) < 0.03] = np.nan
        return {
            "header": header(stamp_ns, self._frame),
            "angle_min": first,
            "angle_max": first + max(count - 1, 0) * increment,
            "angle_increment": increment,
            "time_increment": turn / max(count, 1),
            "scan_time": turn,
            "range_min": 0.0,
            "range_max": 100.0,
            "ranges": ranges,
            "intensities": np.where(np.isnan(ranges), np.nan, 200).astype(np.float32),
        }
