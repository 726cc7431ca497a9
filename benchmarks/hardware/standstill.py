"""A robot in the loop whose processes are killed, stopped and held while it drives: how soon it stands.

All processes as on board, the devices emulated in wall time. The emulated base goes on as it was last told.
Told to stand it brakes as the robot's model does, which is the world's and not ours to shorten: both instants
are measured, that at which the wheels are told and that at which they stand.
"""

import statistics
import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.table import Table

from actors.processes.kernels import compile_kernels
from benchmarks.hardware.standstill_rig import GUARDIAN, Rig, held, killed, stopped
from benchmarks.measured import Measured, table_of
from firmware_bridge.device_lines import RADIO, RANGE

PROCESSES: Final = {
    "robot": "actors.robot",
    "bridge": "firmware_bridge.onboard.bridge",
    "base": "firmware_bridge.onboard.base",
    "guardian": GUARDIAN,
    "supervisor": "onboard",
}
"""Each by a word of its command line."""
HARMLESS: Final = frozenset(
    {("bridge", "killed"), ("bridge", "stopped"), ("bridge", "held")}
    | {("supervisor", "stopped"), ("supervisor", "held"), ("radio", "unplugged")}
)
"""These leave a robot that knows where it is, sees and obeys: it may drive on."""
DEVICES: Final = {
    ("lidar", "silent"): f"silence r1 {RANGE}",
    ("lidar", "unplugged"): f"unplug r1 {RANGE}",
    ("lidar", "without echo"): "darken r1",
    ("lidar", "held fast"): "jam r1",
    ("base's feedback", "silent"): "silence r1 base",
    ("motor", "over-current"): "strain r1 left",
    ("battery", "nearly empty"): "battery r1 13.0",
    ("radio", "unplugged"): f"unplug r1 {RADIO}",
}


GOAL_S: Final = 0.3
GOAL_M: Final = 0.15
"""Within so long, and so far, the wheels are to be told."""


@dataclass(frozen=True)
class StandstillCase:
    """What one event came to."""

    told_s: float | None
    """Until the wheels were told to stand; None: they were not."""
    told_m: float
    """The way until then; if they were not told, that of two seconds."""
    stood_s: float | None
    """Until they stood; None: they did not, or went on before."""
    stood_m: float
    speed: float
    """Just before the event, m/s."""


Case = tuple[str, str]


def check(trials: int = 3, cases: Sequence[Case] | None = None) -> Measured:
    """So many trials of each case, all if none are named; it holds where all stand in time."""
    compile_kernels()  # or the first robot would take a minute to start
    found: dict[Case, list[StandstillCase]] = defaultdict(list)
    for _ in range(trials):
        for case, event in events(cases).items():
            found[case].append(trial(event))
    figures = {
        "task": {"trials": trials, "goal_s": GOAL_S, "goal_m": GOAL_M},
        "cases": {" ".join(case): [asdict(one) for one in some] for case, some in found.items()},
        "goal_met": all(meets(case, some) for case, some in found.items()),
    }
    return Measured(figures, _shown(found), bool(figures["goal_met"]))


def events(cases: Sequence[Case] | None = None) -> dict[Case, Callable[[Rig], None]]:
    """What happens, by what it happens to and how; all, or only these."""
    ways = {"killed": killed, "stopped": stopped, "held": held}
    made: dict[Case, Callable[[Rig], None]] = {
        (process, way): lambda rig, word=word, act=act: act(rig.processes(word))  # type: ignore[misc]
        for process, word in PROCESSES.items()
        for way, act in ways.items()
    }
    made["base and guardian", "stopped"] = lambda rig: stopped(
        [*rig.processes(PROCESSES["base"]), *rig.processes(GUARDIAN)]
    )
    for case, order in DEVICES.items():
        made[case] = lambda rig, order=order: rig.expect_ok(order)  # type: ignore[misc]
    return made if cases is None else {case: made[case] for case in cases}


def meets(case: Case, trials: list[StandstillCase]) -> bool:
    """True if the wheels were told in time each time, or it may drive on."""
    if may_drive_on(case):
        return True
    return all(one.told_s is not None and one.told_s <= GOAL_S and one.told_m <= GOAL_M for one in trials)


def may_drive_on(case: Case) -> bool:
    """True if a robot is left that knows where it is, sees, obeys and has a guardian."""
    return case in HARMLESS


def trial(event: Callable[[Rig], None]) -> StandstillCase:
    """One robot that drives, and the event. Raises NotDrivingError."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder, Rig(Path(folder)) as rig:
        rig.until_driving()
        return measured(rig, event)


def measured(rig: Rig, event: Callable[[Rig], None]) -> StandstillCase:
    """What an event comes to for a robot that drives."""
    before = rig.where()
    event(rig)
    told, stood = rig.standing(patience_s=2.0)
    return StandstillCase(
        None if told is None else told.time - before.time,
        (told or rig.where()).way - before.way,
        None if stood is None else stood.time - before.time,
        (stood or told or rig.where()).way - before.way,
        before.speed,
    )


def _shown(found: dict[Case, list[StandstillCase]]) -> tuple[Table | str, ...]:
    rows = [_row(case, trials) for case, trials in found.items()]
    speeds = [one.speed for trials in found.values() for one in trials]
    goal = (
        f"goal: told within {GOAL_S:g} s and {GOAL_M:g} m; {max(map(len, found.values()))} trials each at "
        f"{min(speeds):.2f} to {max(speeds):.2f} m/s"
    )
    return table_of(rows, "standstill"), goal


def _row(case: Case, trials: list[StandstillCase]) -> dict[str, str]:
    middle, worst = _times([one.told_s for one in trials])
    verdict = "may drive on" if may_drive_on(case) else ""
    return {
        "what": case[0],
        "how": case[1],
        "told, median": middle,
        "worst": worst,
        "way": f"{max(one.told_m for one in trials):.2f} m",
        "stood, worst": _times([one.stood_s for one in trials])[1],
        "way until then": f"{max(one.stood_m for one in trials):.2f} m",
        "": verdict if meets(case, trials) else "MISSED",
    }


def _times(times: list[float | None]) -> tuple[str, str]:
    """Median and worst of them."""
    known = [time for time in times if time is not None]
    if not known:
        return "never", "never"
    worst = f"{len(times) - len(known)} never" if len(known) < len(times) else f"{max(known):.2f} s"
    return f"{statistics.median(known):.2f} s", worst
