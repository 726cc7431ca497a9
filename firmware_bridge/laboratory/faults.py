"""Faults of a robot's emulated hardware, injected by one line of text: `unplug r2 radio`."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from actors.instant import START, Duration, in_seconds
from actors.runtime.errors import AcrcError
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.device_lines import DEVICES, Jack, Lines
from firmware_bridge.kobuki.base import Faults
from firmware_bridge.laboratory.laboratory import EmulatedHardware, Laboratory
from firmware_bridge.range_sensors.rplidar import Health

_USAGE: Final = {
    "battery": "VOLTS",
    "darken": "",
    "deafen": "",
    "edge": "",
    "gps": "SENTENCE",
    "gyro": "works|frozen|absent",
    "heal": "",
    "jam": "",
    "lift": "",
    "lower": "",
    "plug": "base|radio|range",
    "press": "bumper|left|centre|right|radio",
    "reboot": "radio",
    "release": "",
    "scramble": "base|radio|range SHARE",
    "sicken": "",
    "silence": "base|range",
    "strain": "left|right|none",
    "unplug": "base|radio|range",
    "where": "",
}
"""The words after verb and robot."""
_BASE: Final[Mapping[tuple[str, ...], Mapping[str, Any]]] = {
    ("deafen",): {"deaf": True},
    ("edge",): {"cliff": 7},
    ("gyro", "works"): {"gyro": "works"},
    ("gyro", "frozen"): {"gyro": "frozen"},
    ("gyro", "absent"): {"gyro": "absent"},
    ("lift",): {"wheel_drop": 3},
    ("lower",): {"wheel_drop": 0},
    ("press", "bumper"): {"bumper": 2},
    ("press", "left"): {"bumper": 4},
    ("press", "centre"): {"bumper": 2},
    ("press", "right"): {"bumper": 1},
    ("release",): {"bumper": 0},
    ("silence", "base"): {"silent": True},
    ("strain", "left"): {"overcurrent": 1},
    ("strain", "right"): {"overcurrent": 2},
    ("strain", "none"): {"overcurrent": 0},
}
"""Faults of the base by verb and words."""
_LIDAR: Final[Mapping[tuple[str, ...], Mapping[str, Any]]] = {
    ("darken",): {"dark": True},
    ("jam",): {"stuck": True},
    ("sicken",): {"health": Health(2, 1)},
    ("silence", "range"): {"silent": True},
}
"""Faults of the lidar: no echo, a blocked head, an error code after which it does not scan, silence."""
_HEALTHY_LIDAR: Final = {"dark": False, "stuck": False, "health": Health(0), "silent": False}


class Bench:
    """Injects and removes faults."""

    def __init__(self, laboratory: Laboratory, lines: Lines) -> None:
        self._laboratory = laboratory
        self._lines = lines

    def do(self, line: str) -> str:
        """Carry out one line (verb, robot, further words) and return the answer, mostly "ok".

        Raises AcrcError for a line that cannot be carried out.
        """
        verb, *words = line.split() or [""]
        if verb not in _USAGE:
            raise AcrcError(f"there is no {verb!r}; it should be one of {', '.join(_USAGE)}")
        robots = self._laboratory.robots
        robot = words[0] if words else ""
        if robot not in robots:
            raise AcrcError(f"there is no robot {robot!r}; it should be one of {', '.join(robots)}")
        for word, choice in zip(words[1:], _USAGE[verb].split(), strict=False):
            if choice.islower() and word not in choice.split("|"):
                raise AcrcError(f"there is no {word!r} here; it should be one of {choice}")
        if len(words) != 1 + len(_USAGE[verb].split()):
            raise AcrcError(f"{line.strip()!r} should be {f'{verb} ROBOT {_USAGE[verb]}'.rstrip()!r}")
        return self._do(robots[robot], robot, (verb, *words[1:])) or "ok"

    def _do(self, hardware: EmulatedHardware, robot: str, words: tuple[str, ...]) -> str | None:
        for target, faults in ((hardware.base.faults, _BASE), (hardware.lidar, _LIDAR)):
            for field, value in faults.get(words, {}).items():
                setattr(target, field, value)
        match words:
            case ("lift",):
                hardware.body.drive(0.0, 0.0)
            case ("battery", volts):
                hardware.base.faults.battery = _number(volts, "a voltage", 25.5)
            case ("heal",):
                self._heal(hardware, robot)
            case ("where",):
                return self._where(hardware, robot)
            case ("plug" | "unplug" | "scramble", device, *share):
                self._change_line(words[0], Jack(robot, device), share)
            case ("press" | "reboot", "radio") | ("gps", _):
                self._change_board(hardware, robot, words)
        return None

    def _change_line(self, verb: str, jack: Jack, share: Sequence[str]) -> None:
        if verb == "scramble":
            self._lines.scramble(jack, _number(share[0], "a share", 1.0))
        elif (verb == "plug") is self._lines.is_plugged(jack):
            state = (
                "plugged in already; unplug it first" if verb == "plug" else "not plugged in; plug it first"
            )
            raise AcrcError(f"the {jack.device} of {jack.robot} is {state}")
        elif verb == "plug":
            self._lines.plug(jack)
        else:
            self._lines.unplug(jack)

    def _change_board(self, hardware: EmulatedHardware, robot: str, words: Sequence[str]) -> None:
        board, now = hardware.radio, self._laboratory.instant
        if not isinstance(board, EmulatedBoard):
            raise AcrcError(f"{robot} has no board; its transceiver is a simulated one")
        if words[0] == "gps":
            board.gps(now, words[1].encode())
        elif words[0] == "press":
            board.press(now)
        else:
            board.reboot(now)

    def _heal(self, hardware: EmulatedHardware, robot: str) -> None:
        """Remove all faults and plug in all cables."""
        hardware.base.faults = Faults()
        for field, value in _HEALTHY_LIDAR.items():
            setattr(hardware.lidar, field, value)
        for jack in (Jack(robot, device) for device in DEVICES):
            self._lines.scramble(jack, 0.0)
            if not self._lines.is_plugged(jack):
                self._lines.plug(jack)

    def _where(self, hardware: EmulatedHardware, robot: str) -> str:
        """Ground truth: time, s; distance travelled, m; speed, m/s; 1 if the wheels are told to stand."""
        time = in_seconds(Duration(self._laboratory.now - START))
        told_to_stand = int(hardware.body.is_told_to_stand)
        speed = hardware.body.truth().v
        return f"{time:.3f} {self._laboratory.travelled(robot):.4f} {speed:.4f} {told_to_stand}"


def _number(word: str, what: str, most: float) -> float:
    """A number from 0 to `most`."""
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0 <= value <= most:
        raise AcrcError(f"{word!r} is not {what}; it should be a number from 0 to {most:g}")
    return value
