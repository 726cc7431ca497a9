"""The parts of a swarm that a budget tells apart: of world, radio and shell, and what a robot is made of."""

import inspect
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Final
from unittest.mock import patch

from actors.radio.core import RadioCore
from actors.radio.medium.medium import Medium
from actors.robot.core import RobotCore, RobotParts
from actors.runtime import shell as shells
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.message_counts import MessageCounts
from actors.runtime.recording import Recorder
from actors.runtime.shell import Shell
from actors.task.referee import Referee
from actors.world.body import Bodies
from actors.world.core import WorldCore
from actors.world.odometry import Odometers
from actors.world.physics import Arena
from actors.world.sensing import RangeSensors
from benchmarks.swarm import process_figures
from benchmarks.swarm.part_clock import PartClock, Target, calls_of

_CLASSES: Final[dict[type, str]] = {
    WorldCore: "conducting",
    Bodies: "bodies",
    Arena: "physics",
    Odometers: "odometry",
    RangeSensors: "range scans",
    Referee: "referee",
    RadioCore: "stations and events",
    Medium: "medium",
    RobotCore: "core",
    Recorder: "recorder",
    MessageCounts: "sequence numbers",
    MemoryBus: "memory bus",
}
_HOMES: Final = ("actors.robot.", "deeco.", "cleaning.")
"""Where the classes of a robot's parts, and of their parts, are at home."""
_DEPTH: Final = 3
"""So deep are parts of parts told apart."""


def targets(cores: Iterable[object]) -> list[Target]:
    """Everything to be clocked in a swarm of these cores, all robots of which are made alike."""
    found = [target for owner, part in _CLASSES.items() for target in calls_of(owner, part)]
    found += [Target(shells, name, "codec") for name in ("encode", "decode")]
    robot = next((core for core in cores if isinstance(core, RobotCore)), None)
    return found if robot is None else [*found, *_robot_targets(robot)]


def pumps_clocked(clock: PartClock) -> AbstractContextManager[object]:
    """Clock the shells too, which tell the clock whose turn it is."""
    pump = clock.wrap(Shell.pump, "shell", lambda shell: process_figures.kind(shell.actor))
    return patch.object(Shell, "pump", pump)


def _robot_targets(core: RobotCore) -> Iterator[Target]:
    """The robot's parts by the names that they have in Parts; what is in them, by its class too."""
    parts = next(value for value in vars(core).values() if isinstance(value, RobotParts))
    level = [(field.name, field.name, getattr(parts, field.name)) for field in fields(parts)]
    seen: set[type] = set()
    for _ in range(_DEPTH):
        below = []
        for part, root, thing in level:
            if _is_part(thing) and type(thing) not in seen:
                seen.add(type(thing))
                yield from calls_of(type(thing), part)
                below += [
                    (f"{root}: {type(inner).__name__.lstrip('_')}", root, inner) for inner in _inside(thing)
                ]
        level = below


def _is_part(thing: object) -> bool:
    """True for what works, not for values: parameters, messages, knowledge."""
    home = type(thing).__module__
    value = is_dataclass(thing) or isinstance(thing, (Enum, tuple))
    return not value and not inspect.isroutine(thing) and f"{home}.".startswith(_HOMES)


def _inside(thing: object) -> Iterator[object]:
    for value in getattr(thing, "__dict__", {}).values():
        if isinstance(value, Sequence) and not isinstance(value, str | bytes):
            yield from value
        else:
            yield value
