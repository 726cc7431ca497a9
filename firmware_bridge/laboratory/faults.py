"""What may go wrong with a robot's hardware, as words of one line: `unplug r2 radio`."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeVar

from actors.instant import START, Duration, in_seconds
from actors.runtime.errors import AcrcError
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.device_lines import BASE, DEVICES, RADIO, RANGE, Jack, Lines
from firmware_bridge.kobuki.base import Faults
from firmware_bridge.laboratory.laboratory import EmulatedHardware, Laboratory
from firmware_bridge.range_sensors.rplidar import Health

_BUMPER: Final = {"bumper": 2, "left": 4, "centre": 2, "right": 1}
_GYRO: Final[Mapping[str, Literal["works", "frozen", "absent"]]] = {
    "works": "works",
    "frozen": "frozen",
    "absent": "absent",
}
_BOTH_WHEELS: Final = 3
_ALL_CLIFFS: Final = 7
_ERROR: Final = Health(2, 1)
_BATTERY_V: Final = 25.5
"""The most that a base can say, V."""
T = TypeVar("T")


@dataclass(frozen=True)
class _Fault:
    usage: str
    """What follows the verb."""
    act: Callable[["Bench", str, Sequence[str]], str | None]


class Bench:
    """Does what a line says: `do` raises AcrcError if it cannot be done."""

    def __init__(self, laboratory: Laboratory, lines: Lines) -> None:
        self._laboratory = laboratory
        self._lines = lines

    def do(self, line: str) -> str:
        """One line: verb, robot, and what the verb asks for; the answer, mostly "ok"."""
        verb, *words = line.split() or [""]
        fault = _FAULTS.get(verb)
        if fault is None:
            raise AcrcError(f"there is no {verb!r}; it should be one of {', '.join(sorted(_FAULTS))}")
        robots = self._laboratory.robots
        if not words or words[0] not in robots:
            robot = words[0] if words else ""
            raise AcrcError(f"there is no robot {robot!r}; it should be one of {', '.join(robots)}")
        if len(words) != 1 + len(fault.usage.split()):
            raise AcrcError(f"{line.strip()!r} has a wrong number of words; it should be {_form(verb)!r}")
        return fault.act(self, words[0], words[1:]) or "ok"

    # --- what the verbs do ---

    def press(self, robot: str, words: Sequence[str]) -> None:
        """The base's bumper, or the board's button."""
        if bits := _one_of(words[0], {**_BUMPER, RADIO: 0}):
            self._of(robot).base.faults.bumper |= bits
        else:
            self._board(robot).press(self._laboratory.instant)

    def release(self, robot: str, _: Sequence[str]) -> None:
        """The bumper again."""
        self._of(robot).base.faults.bumper = 0

    def lift(self, robot: str, _: Sequence[str]) -> None:
        """The robot stands still, and its wheels hang."""
        hardware = self._of(robot)
        hardware.base.faults.wheel_drop = _BOTH_WHEELS
        hardware.body.drive(0.0, 0.0)

    def lower(self, robot: str, _: Sequence[str]) -> None:
        """Back on the floor."""
        self._of(robot).base.faults.wheel_drop = 0

    def edge(self, robot: str, _: Sequence[str]) -> None:
        """All cliff sensors see a step down."""
        self._of(robot).base.faults.cliff = _ALL_CLIFFS

    def silence(self, robot: str, words: Sequence[str]) -> None:
        """The device sends nothing any more."""
        if _one_of(words[0], {BASE: True, RANGE: False}):
            self._of(robot).base.faults.silent = True
        else:
            self._of(robot).lidar.silent = True

    def deafen(self, robot: str, _: Sequence[str]) -> None:
        """The base does for ever what it was told last."""
        self._of(robot).base.faults.deaf = True

    def gyro(self, robot: str, words: Sequence[str]) -> None:
        """The base's gyro works, says the same for ever, or is not there."""
        self._of(robot).base.faults.gyro = _one_of(words[0], _GYRO)

    def battery(self, robot: str, words: Sequence[str]) -> None:
        """The base's voltage."""
        self._of(robot).base.faults.battery = _number(words[0], "a voltage", _BATTERY_V)

    def sicken(self, robot: str, _: Sequence[str]) -> None:
        """The lidar says that it is broken, and scans no more once it is asked again."""
        self._of(robot).lidar.health = _ERROR

    def darken(self, robot: str, _: Sequence[str]) -> None:
        """The lidar gets no echo any more."""
        self._of(robot).lidar.dark = True

    def jam(self, robot: str, _: Sequence[str]) -> None:
        """The lidar's head is held; it measures on."""
        self._of(robot).lidar.stuck = True

    def strain(self, robot: str, words: Sequence[str]) -> None:
        """Over-current at a wheel of the base, or none any more."""
        self._of(robot).base.faults.overcurrent = _one_of(words[0], {"left": 1, "right": 2, "none": 0})

    def gps(self, robot: str, words: Sequence[str]) -> None:
        """A line from the GPS module of the board."""
        self._board(robot).gps(self._laboratory.instant, words[0].encode())

    def reboot(self, robot: str, words: Sequence[str]) -> None:
        """The board begins anew."""
        _one_of(words[0], {RADIO: None})
        self._board(robot).reboot(self._laboratory.instant)

    def scramble(self, robot: str, words: Sequence[str]) -> None:
        """A share of the line's bytes is replaced, lost or doubled, both ways."""
        share = _number(words[1], "a share", 1.0)
        self._lines.scramble(_jack(robot, words[0]), share)

    def unplug(self, robot: str, words: Sequence[str]) -> None:
        """The cable is out."""
        jack = _jack(robot, words[0])
        if not self._lines.is_plugged(jack):
            raise AcrcError(f"the {jack.device} of {robot} is not plugged in; plug it first")
        self._lines.unplug(jack)

    def plug(self, robot: str, words: Sequence[str]) -> None:
        """The cable is in again."""
        jack = _jack(robot, words[0])
        if self._lines.is_plugged(jack):
            raise AcrcError(f"the {jack.device} of {robot} is plugged in already; unplug it first")
        self._lines.plug(jack)

    def heal(self, robot: str, _: Sequence[str]) -> None:
        """Everything works again; what is unplugged is plugged in."""
        hardware = self._of(robot)
        hardware.base.faults = Faults()
        hardware.lidar.silent, hardware.lidar.health = False, Health(0)
        hardware.lidar.dark = hardware.lidar.stuck = False
        for device in DEVICES:
            jack = Jack(robot, device)
            self._lines.scramble(jack, 0.0)
            if not self._lines.is_plugged(jack):
                self._lines.plug(jack)

    def where(self, robot: str, _: Sequence[str]) -> str:
        """No fault, but the truth: time, s, way so far, m, speed, m/s, and 1 if told to stand."""
        laboratory = self._laboratory
        time = in_seconds(Duration(laboratory.now - START))
        body = self._of(robot).body
        way, told = laboratory.travelled(robot), int(body.is_told_to_stand)
        return f"{time:.3f} {way:.4f} {body.truth().v:.4f} {told}"

    def _of(self, robot: str) -> EmulatedHardware:
        return self._laboratory.robots[robot]

    def _board(self, robot: str) -> EmulatedBoard:
        radio = self._of(robot).radio
        if not isinstance(radio, EmulatedBoard):
            raise AcrcError(f"{robot} has no board; its transceiver is a simulated one")
        return radio


_FAULTS: Final = {
    "battery": _Fault("VOLTS", Bench.battery),
    "darken": _Fault("", Bench.darken),
    "deafen": _Fault("", Bench.deafen),
    "edge": _Fault("", Bench.edge),
    "gps": _Fault("SENTENCE", Bench.gps),
    "gyro": _Fault("STATE", Bench.gyro),
    "heal": _Fault("", Bench.heal),
    "jam": _Fault("", Bench.jam),
    "lift": _Fault("", Bench.lift),
    "lower": _Fault("", Bench.lower),
    "plug": _Fault("DEVICE", Bench.plug),
    "press": _Fault("WHAT", Bench.press),
    "reboot": _Fault("radio", Bench.reboot),
    "release": _Fault("", Bench.release),
    "scramble": _Fault("DEVICE SHARE", Bench.scramble),
    "sicken": _Fault("", Bench.sicken),
    "silence": _Fault("DEVICE", Bench.silence),
    "strain": _Fault("WHEEL", Bench.strain),
    "unplug": _Fault("DEVICE", Bench.unplug),
    "where": _Fault("", Bench.where),
}


def _form(verb: str) -> str:
    return f"{verb} ROBOT {_FAULTS[verb].usage}".rstrip()


def _jack(robot: str, device: str) -> Jack:
    _one_of(device, dict.fromkeys(DEVICES))
    return Jack(robot, device)


def _one_of(word: str, known: Mapping[str, T]) -> T:
    if word not in known:
        raise AcrcError(f"there is no {word!r} here; it should be one of {', '.join(known)}")
    return known[word]


def _number(word: str, what: str, most: float) -> float:
    """A number from 0 to `most`."""
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0 <= value <= most:
        raise AcrcError(f"{word!r} is not {what}; it should be a number from 0 to {most:g}")
    return value
