"""Robots whose sensors lie: how soon and after what way each lie is told; and robots whose sensors do not.

In simulated time, on emulated devices, on several floors and at several speeds; told is when the wheels are.
"""

import itertools
import statistics
import tempfile
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.table import Table

from actors.processes.kernels import compile_kernels
from benchmarks.hardware.sensor_faults import FAULTS, SensorFault
from benchmarks.hardware.sensor_rig import SensorRig
from benchmarks.hardware.sensor_situations import FLOORS, SITUATIONS, accusations, starts_on
from benchmarks.measured import Measured
from tests.parallel import in_order

SPEEDS: Final = (0.5, 0.5, 0.3, 0.4)
"""m/s, by seed."""
_PATIENCE_S: Final = 4.0
_STARTED: Final = 2.0
_MOST_S: Final = 120.0


@dataclass(frozen=True)
class SensorCase:
    """What one fault came to."""

    told_s: float | None
    """Until the wheels were told to stand; None: they were not."""
    told_m: float
    """The way until then, m; if they were not told, that of 4 s."""
    said: tuple[str, ...]
    """Names of the causes that held it then."""


@dataclass(frozen=True)
class Peace:
    """What a situation without a fault came to."""

    name: str
    robot_s: float
    way_m: float
    accused: tuple[str, ...]


def trial(fault: SensorFault, seed: int) -> SensorCase:
    """One robot that drives, and the fault."""
    floor, speed = FLOORS[seed % len(FLOORS)], SPEEDS[seed % len(SPEEDS)]
    rig = SensorRig(floor, starts_on(floor, seed, 1), seed, speed)
    vehicle = rig.vehicles["r1"]
    pilot = vehicle.pilot
    assert pilot is not None
    pilot.straight = not fault.bends
    if fault.from_start:
        vehicle.pilot = None
        rig.run(_STARTED)
        fault.act(rig)
        rig.run(_STARTED)  # what is late comes late
        vehicle.pilot = pilot
        rig.run(_PATIENCE_S, lambda: rig.speed() > 0.02)
    else:
        rig.run(_MOST_S, lambda: rig.cruises(0.9 * speed, fault.bends))
        fault.act(rig)
    begun, way, before = rig.now, rig.laboratory.travelled("r1"), len(vehicle.told)
    rig.run(_PATIENCE_S, rig.told_to_stand)
    said = vehicle.told[-1].causes if len(vehicle.told) > before else frozenset()
    return SensorCase(
        (rig.now - begun) / 1e6 if rig.told_to_stand() else None,
        rig.laboratory.travelled("r1") - way,
        tuple(sorted(cause.name for cause in said)),
    )


def within(fault: SensorFault, case: SensorCase) -> bool:
    """True if it was told in time, or is only measured."""
    if fault.limit is None:
        return True
    time_s, way = fault.limit
    return case.told_s is not None and case.told_s <= time_s + 1e-6 and case.told_m <= way


def peace(number: int) -> Peace:
    """The situation of that number, again and again with other seeds."""
    seed, which = divmod(number, len(SITUATIONS))
    situation = SITUATIONS[which]
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        rig = situation.build(seed, Path(folder))
        rig.run(situation.time_s / 2)
        if situation.event is not None:
            situation.event(rig)
        rig.run(situation.time_s / 2)
    way = sum(rig.laboratory.travelled(robot) for robot in rig.vehicles)
    told = tuple(f"{robot} at {at:.1f} s: {cause}" for robot, at, cause in accusations(rig))
    return Peace(situation.name, situation.time_s * len(rig.vehicles), way, told)


def check(trials: int = 20, hours: float = 2.0) -> Measured:
    """So many trials of each fault, and so many simulated hours of robots whose sensors are right.

    It holds where each fault is told within its limits, and nobody is accused without one.
    """
    compile_kernels()
    pairs = list(itertools.product(range(len(FAULTS)), range(trials)))
    found = list(in_order(_trial, pairs))
    cases = [
        [one for (fault, _), one in zip(pairs, found, strict=True) if fault == which]
        for which in range(len(FAULTS))
    ]
    calm = list(in_order(peace, range(_situations(hours))))
    by_fault = zip(FAULTS, cases, strict=True)
    figures: dict[str, object] = {
        "task": {"trials": trials, "hours": hours},
        "faults": {f"{fault.what}: {fault.how}": [asdict(one) for one in runs] for fault, runs in by_fault},
        "calm": [asdict(one) for one in calm],
        "goal_met": not any(one.accused for one in calm)
        and all(within(fault, one) for fault, runs in zip(FAULTS, cases, strict=True) for one in runs),
    }
    return Measured(figures, _shown(cases, calm), bool(figures["goal_met"]))


def _trial(pair: tuple[int, int]) -> SensorCase:
    return trial(FAULTS[pair[0]], pair[1])


def _situations(hours: float) -> int:
    """How many make so many hours of robots."""
    count, time_s = 0, 0.0
    while time_s < hours * 3600:
        one = SITUATIONS[count % len(SITUATIONS)]
        count, time_s = count + 1, time_s + one.time_s * one.robots
    return count


def _shown(cases: list[list[SensorCase]], calm: list[Peace]) -> list[Table | str]:
    heads = ("what", "how", "told, median", "worst", "way, worst", "not told", "said", "")
    table = Table(*heads, title="sensors")
    for fault, trials in zip(FAULTS, cases, strict=True):
        times = [one.told_s for one in trials if one.told_s is not None]
        said = Counter(cause for one in trials for cause in one.said)
        missed = sum(not within(fault, one) for one in trials)
        table.add_row(
            fault.what,
            fault.how,
            f"{statistics.median(times):.2f} s" if times else "never",
            f"{max(times):.2f} s" if times else "never",
            f"{max(one.told_m for one in trials):.2f} m",
            f"{len(trials) - len(times)} of {len(trials)}",
            ", ".join(f"{cause} {count}" for cause, count in said.most_common(3)),
            f"{missed} MISSED" if missed else "" if fault.limit else "no limit",
        )
    hours, way = sum(one.robot_s for one in calm) / 3600, sum(one.way_m for one in calm)
    accused = [f"{one.name}: {said}" for one in calm for said in one.accused]
    peaceful = (
        f"without a fault: {len(accused)} false alarms in {hours:.1f} h and {way:.0f} m of robots, in "
        f"{len(calm)} runs of {len(SITUATIONS)} situations"
    )
    return [table, peaceful, *accused]
