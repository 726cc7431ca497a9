"""`acrc bench budget`: counted cost of a robot in one step, in memory and over Zenoh."""

import shutil
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import Any, Final, get_args

from rich.table import Table

from acrc_testbed.benchmarks.measured import ACRC, Measured, Spent, spent
from acrc_testbed.benchmarks.swarm_runs import (
    SwarmTask,
    by_room,
    counted_blocks,
    entries,
    name_of,
    planned,
    profiled,
    recorded_bytes,
)
from actors.console import screen
from actors.installation.repository import clone
from actors.installation.usage import OptionError, check_choice, wrong_value
from actors.runtime.shell import MemoryBus
from deploy.run import swarm
from deploy.run.options import Bus
from deploy.scenario.tables import document

ROBOTS: Final = 8
SECONDS: Final = 9.0
"""Simulated, of the longer run."""
TABLE: Final = Path(__file__).with_name("python{}.{}.toml".format(*sys.version_info))
"""Counts kept for this version of Python; absent for others, which call other functions."""
TOLERANCE: Final = 0.02
"""Largest relative difference of a sum from the kept one."""
KEPT: Final = {
    "calls": "Python calls",
    "messages": "messages",
    "sent": "bytes sent",
    "recorded": "bytes recorded",
}
"""Fields of `StepCounts` that are kept and compared, with their descriptions."""
_SEED: Final = 1
_STEPS_PER_SECOND: Final = 10
"""Steps of the scenario per simulated second."""
_OWN: Final = "acrc_testbed/benchmarks"
"""Calls from these packages are the counting itself."""
_TRACER: Final = "strace"
_LEAST: Final = 0.0005
_NAMED: Final = 5
"""Largest number of packages that a difference names."""
_DIGITS: Final = 3
_HEAD: Final = (
    "# What one robot costs in one step, counted. `acrc bench budget` shows it, and with --write it writes\n"
    "# this file. A commit that changes it says why a step costs more, or less.\n\n"
)


@dataclass(frozen=True)
class CountedSteps:
    """The steps by which a run exceeds one a third as long; start and end of a run are not counted."""

    seconds: float = SECONDS
    """Simulated, of the longer run."""

    @property
    def first_s(self) -> float:
        """Return the start of the counted steps, simulated s; a whole number."""
        return float(self.seconds // 3)

    @property
    def tasks(self) -> tuple[SwarmTask, SwarmTask]:
        """Return the shorter run and the longer one."""
        return (
            SwarmTask((ROBOTS,), self.first_s, None, seed=_SEED),
            SwarmTask((ROBOTS,), self.seconds, None, seed=_SEED),
        )

    def per_step(self, short: Mapping[str, float], long: Mapping[str, float]) -> dict[str, float]:
        """Return the difference of two runs per robot and step; by name, the greatest first."""
        steps = ROBOTS * (self.seconds - self.first_s) * _STEPS_PER_SECOND
        more = {name: (long.get(name, 0.0) - short.get(name, 0.0)) / steps for name in {**short, **long}}
        return dict(sorted(more.items(), key=lambda one: (-one[1], one[0])))


@dataclass(frozen=True)
class StepCounts:
    """Per robot and step in memory, the work of world and radio for it included."""

    calls: dict[str, float]
    """Python calls, built-in functions included, by package folder."""
    messages: dict[str, float]
    """By topic."""
    sent: dict[str, float]
    """Bytes of these messages, by topic."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""
    functions: dict[str, float]
    """Calls by function."""


@dataclass(frozen=True)
class MeshCounts:
    """Per robot and step over Zenoh, all processes together; scheduling changes it slightly."""

    system_calls: dict[str, float] | None
    """By name; None: strace is not installed."""
    voluntary: float
    """Context switches of processes that waited."""
    forced: float
    """Context switches of processes that could have continued."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""


def counted(window: CountedSteps) -> StepCounts:
    """Count in memory, after a short run that imports modules and loads kernels."""
    with planned(ROBOTS, replace(window.tasks[0], seconds=2.0), "memory") as plan:
        swarm.run_in_memory(plan, lambda progress: None)
    short, long = map(_profiled, window.tasks)
    names = [field.name for field in fields(StepCounts)]
    return StepCounts(*(window.per_step(getattr(short, name), getattr(long, name)) for name in names))


def blocks(window: CountedSteps) -> float:
    """Count memory blocks allocated per robot and step, freed ones included, in a warm process."""
    found = []
    for task in window.tasks:
        with planned(ROBOTS, task, "memory") as plan, counted_blocks() as count:
            swarm.run_in_memory(plan, lambda progress: None)
        found.append({"": float(count[0])})
    return window.per_step(*found)[""]


def _profiled(task: SwarmTask) -> StepCounts:
    """Count one whole run, from planning to its result."""
    bus = _CountingBus()
    profile, recorded = profiled(ROBOTS, task, bus)
    called = entries(profile)
    functions: defaultdict[str, float] = defaultdict(float)
    for function, (times, _) in called.items():
        functions[name_of(function)] += times
    rooms = {room: times for room, times in by_room(called).items() if not room.startswith(_OWN)}
    return StepCounts(rooms, bus.messages, bus.sent, recorded, functions)


class _CountingBus(MemoryBus):
    """A memory bus that counts messages and bytes by topic."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: defaultdict[str, float] = defaultdict(float)
        self.sent: defaultdict[str, float] = defaultdict(float)

    def publish(self, key: str, payload: bytes) -> None:
        """Count the message and publish it."""
        parts = key.split("/")
        if parts[1] in {"up", "down"}:
            parts[2] = "{id}"
        topic = "/".join(parts)
        self.messages[topic] += 1
        self.sent[topic] += len(payload)
        super().publish(key, payload)


def mesh_counted(window: CountedSteps) -> MeshCounts:
    """Count over Zenoh. Raises AcrcError if a run fails."""
    plain = [_over_mesh(task) for task in window.tasks]
    switches = window.per_step(*({"voluntary": of.voluntary, "forced": of.forced} for of, _, _ in plain))
    traced = None
    if shutil.which(_TRACER):
        traced = window.per_step(*(_over_mesh(task, traced=True)[2] for task in window.tasks))
    recorded = window.per_step(*(sizes for _, sizes, _ in plain))
    return MeshCounts(traced, switches["voluntary"], switches["forced"], recorded)


def _over_mesh(
    task: SwarmTask, *, traced: bool = False
) -> tuple[Spent, Mapping[str, float], Mapping[str, float]]:
    """Return cost and recorded bytes of one run, and its system calls by name if it is `traced`."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out, table = Path(folder) / "out", Path(folder) / "calls"
        tracer = (_TRACER, "-f", "-c", "-U", "name,calls", "-o", str(table)) if traced else ()
        words = (
            *("run", str(task.scenario), "--robots", str(ROBOTS), "--seed", str(task.seed)),
            *("--duration", f"{task.seconds:g}", "--bus", "zenoh", "--json", "--out", str(out)),
        )
        of = spent([*tracer, *ACRC, *words])
        rows = [line.split() for line in table.read_text().splitlines()] if traced else []
        counts = {row[0]: float(row[1]) for row in rows if len(row) == 2 and row[1].isdecimal()}
        counts.pop("total", None)
        return of, recorded_bytes(out), counts


def written(counts: StepCounts) -> str:
    """Return the text of the file of kept counts, without negligible ones."""
    tables = {
        name: {one: round(value, _DIGITS) for one, value in getattr(counts, name).items() if value >= _LEAST}
        for name in KEPT
    }
    return _HEAD + document(tables)


def kept_counts() -> StepCounts | None:
    """Read the kept counts of this Python, without functions; None if there are none."""
    if not TABLE.is_file():
        return None
    content = tomllib.loads(TABLE.read_text())
    return StepCounts(**{field.name: content.get(field.name, {}) for field in fields(StepCounts)})


def differences(now: StepCounts, kept: StepCounts) -> Iterator[str]:
    """Describe each sum that differs by more than TOLERANCE, with the packages that differ most."""
    for name, words in KEPT.items():
        new, old = getattr(now, name), getattr(kept, name)
        change = sum(new.values()) / sum(old.values()) - 1
        if abs(change) > TOLERANCE:
            yield (
                f"a robot-step has {sum(new.values()):.1f} {words}, {TABLE.name} keeps "
                f"{sum(old.values()):.1f} ({change:+.1%}): {_causes(new, old)}; if that is meant, "
                "`acrc bench budget --write` keeps it, and the commit says why"
            )


def _causes(new: Mapping[str, float], old: Mapping[str, float]) -> str:
    """List the greatest changes."""
    changes = {name: new.get(name, 0.0) - old.get(name, 0.0) for name in {**old, **new}}
    most = sorted(changes, key=lambda name: -abs(changes[name]))[:_NAMED]
    return ", ".join(f"{name} {changes[name]:+.1f}" for name in most if abs(changes[name]) >= 0.05)


_LEAST_S: Final = 3.0
_MOST_CALLED: Final = 25
_SHOWN: Final = 0.05
"""Least count per robot-step in the tables."""


def measure(bus: str | None = None, duration: float = SECONDS, write: bool = False) -> Measured:
    """Count on one bus, or on both; `duration`: simulated s, of which the first third is not counted.

    `write`: keep the counts in memory as those of this version of Python.
    """
    check_choice("--bus", bus, get_args(Bus))
    if duration < _LEAST_S:
        raise wrong_value("--duration", f"{duration:g}", f"at least {_LEAST_S:g} for budget")
    if write and (bus == "zenoh" or duration != SECONDS):
        raise OptionError("--write: keeps counts in memory as a test repeats them; cannot be combined with "
                          "--bus zenoh or --duration")  # fmt: skip
    if write:
        clone("acrc bench budget --write")
    say, window = screen(stderr=True), CountedSteps(duration)
    figures: dict[str, Any] = {"robots": ROBOTS, "from_s": window.first_s, "to_s": window.seconds}
    shown: list[Table | str] = []
    if bus != "zenoh":
        say.print(f"{ROBOTS} robots in memory …")
        found, allocated = counted(window), blocks(window)
        figures["memory"] = asdict(found) | {"blocks": allocated}
        shown += _memory(found, allocated, kept_counts() if duration == SECONDS else None)
        if write:
            TABLE.write_text(written(found))
            shown.append(f"{TABLE.name} is written")
    if bus != "memory":
        say.print(f"{ROBOTS} robots over Zenoh …")
        mesh = mesh_counted(window)
        figures["zenoh"] = asdict(mesh)
        shown += _mesh(mesh)
    return Measured(figures, shown)


def _memory(found: StepCounts, allocated: float, kept: StepCounts | None) -> list[Table | str]:
    tables: list[Table | str] = [
        _table(f"{words} per robot-step, in memory", getattr(found, name), getattr(kept, name, None))
        for name, words in KEPT.items()
    ]
    most = dict(islice(found.functions.items(), _MOST_CALLED))
    tables.insert(1, _table("the functions called most, per robot-step", most, None, whole=False))
    tables.append(f"memory blocks allocated per robot-step, freed ones included: {allocated:.1f}")
    if kept is not None:
        tables += [*differences(found, kept)] or [f"{TABLE.name} keeps the same, within 2 %"]
    return tables


def _mesh(found: MeshCounts) -> list[Table | str]:
    shown: list[Table | str] = [_table("bytes recorded per robot-step, over Zenoh", found.recorded, None)]
    if found.system_calls is None:
        shown.append("system calls are not counted: that requires strace")
    else:
        shown.append(_table("system calls per robot-step, over Zenoh", found.system_calls, None))
    switches = f"{found.voluntary:.1f} voluntary, {found.forced:.1f} forced"
    return [*shown, f"context switches per robot-step, over Zenoh: {switches}"]


def _table(
    title: str, found: Mapping[str, float], kept: Mapping[str, float] | None, *, whole: bool = True
) -> Table:
    """Tabulate counts by name beside the kept ones, with the sum if they are the `whole`."""
    rows = Table("", "now", *(("kept",) if kept is not None else ()), title=title)
    old = kept or {}
    lines = {name: (found.get(name, 0.0), old.get(name, 0.0)) for name in {**found, **old}}
    if whole:
        lines["all"] = (sum(found.values()), sum(old.values()))
    for name, values in lines.items():
        if max(values) >= _SHOWN:
            rows.add_row(name, *(f"{value:.1f}" for value in values[: len(rows.columns) - 1]))
    return rows
