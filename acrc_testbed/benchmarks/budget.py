"""`acrc bench budget`: counted cost of a robot-step, in memory and over Zenoh."""

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

from acrc_testbed.benchmarks.benchmark_result import ACRC, BenchmarkResult, CommandCost, run_timed
from acrc_testbed.benchmarks.swarm_runs import (
    SwarmTask,
    by_package,
    count_allocations,
    entries,
    name_of,
    plan_run,
    profile_run,
    recorded_bytes,
)
from actors.console import create_console
from actors.installation.repository import clone
from actors.installation.usage import OptionError, check_choice, wrong_value
from actors.runtime.shell import MemoryBus
from deploy.run import swarm
from deploy.run.options import Bus
from deploy.scenario.tables import document

ROBOTS: Final = 8
SECONDS: Final = 9.0
"""Simulated duration of the longer run, s."""
TABLE: Final = Path(__file__).with_name("python{}.{}.toml".format(*sys.version_info))
"""Saved counts of this version of Python; other versions, which call other functions, may have none."""
TOLERANCE: Final = 0.02
"""Maximum relative difference of a sum from the saved one."""
KEPT: Final = {
    "calls": "Python calls",
    "messages": "messages",
    "sent": "bytes sent",
    "recorded": "bytes recorded",
}
"""Fields of `StepCounts` that are saved and compared, with their descriptions."""
_SEED: Final = 1
_STEPS_PER_SECOND: Final = 10
"""Steps of the scenario per simulated second."""
_OWN: Final = "acrc_testbed/benchmarks"
"""Package of the counting code, whose calls are excluded."""
_TRACER: Final = "strace"
_LEAST: Final = 0.0005
_NAMED: Final = 5
"""Maximum number of packages named per difference."""
_DIGITS: Final = 3
_HEAD: Final = (
    "# Counted cost of a robot-step, written by `acrc bench budget --write`.\n"
    "# The commit that changes it gives the reason.\n\n"
)


@dataclass(frozen=True)
class CountedSteps:
    """The last two thirds of a run, counted as the difference of two runs, without start and end."""

    seconds: float = SECONDS
    """Simulated duration of the longer run, s."""

    @property
    def first_s(self) -> float:
        """Return the start of the counted steps, simulated s (integral)."""
        return float(self.seconds // 3)

    @property
    def tasks(self) -> tuple[SwarmTask, SwarmTask]:
        """Return the shorter run and the longer one."""
        return (
            SwarmTask((ROBOTS,), self.first_s, None, seed=_SEED),
            SwarmTask((ROBOTS,), self.seconds, None, seed=_SEED),
        )

    def per_step(self, short: Mapping[str, float], long: Mapping[str, float]) -> dict[str, float]:
        """Return the difference of two runs per robot-step by name, the greatest first."""
        steps = ROBOTS * (self.seconds - self.first_s) * _STEPS_PER_SECOND
        more = {name: (long.get(name, 0.0) - short.get(name, 0.0)) / steps for name in {**short, **long}}
        return dict(sorted(more.items(), key=lambda one: (-one[1], one[0])))


@dataclass(frozen=True)
class StepCounts:
    """Counts per robot-step in memory, including world and radio."""

    calls: dict[str, float]
    """Python calls, built-in functions included, by package folder."""
    messages: dict[str, float]
    """Messages by topic."""
    sent: dict[str, float]
    """Bytes of these messages, by topic."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""
    functions: dict[str, float]
    """Calls by function."""


@dataclass(frozen=True)
class MeshCounts:
    """Counts per robot-step of all processes over Zenoh; they vary slightly with scheduling."""

    system_calls: dict[str, float] | None
    """System calls by name; None: strace is not installed."""
    voluntary: float
    """Voluntary context switches."""
    forced: float
    """Involuntary context switches."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""


def count_steps(window: CountedSteps) -> StepCounts:
    """Count in memory, after a short run that imports modules and loads kernels."""
    with plan_run(ROBOTS, replace(window.tasks[0], seconds=2.0), "memory") as plan:
        swarm.run_in_memory(plan, lambda progress: None)
    short, long = map(_profiled, window.tasks)
    names = [field.name for field in fields(StepCounts)]
    return StepCounts(*(window.per_step(getattr(short, name), getattr(long, name)) for name in names))


def count_blocks(window: CountedSteps) -> float:
    """Count memory blocks allocated per robot-step, including freed ones, in a warm process."""
    found = []
    for task in window.tasks:
        with plan_run(ROBOTS, task, "memory") as plan, count_allocations() as count:
            swarm.run_in_memory(plan, lambda progress: None)
        found.append({"": float(count[0])})
    return window.per_step(*found)[""]


def _profiled(task: SwarmTask) -> StepCounts:
    """Count one complete run, from planning to the result."""
    bus = _CountingBus()
    profile, recorded = profile_run(ROBOTS, task, bus)
    called = entries(profile)
    functions: defaultdict[str, float] = defaultdict(float)
    for function, (times, _) in called.items():
        functions[name_of(function)] += times
    packages = {name: times for name, times in by_package(called).items() if not name.startswith(_OWN)}
    return StepCounts(packages, bus.messages, bus.sent, recorded, functions)


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


def count_over_mesh(window: CountedSteps) -> MeshCounts:
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
) -> tuple[CommandCost, Mapping[str, float], Mapping[str, float]]:
    """Return cost and recorded bytes of a run and, if `traced`, system calls by name."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        out, table = Path(folder) / "out", Path(folder) / "calls"
        tracer = (_TRACER, "-f", "-c", "-U", "name,calls", "-o", str(table)) if traced else ()
        words = (
            *("run", str(task.scenario), "--robots", str(ROBOTS), "--seed", str(task.seed)),
            *("--duration", f"{task.seconds:g}", "--bus", "zenoh", "--json", "--out", str(out)),
        )
        of = run_timed([*tracer, *ACRC, *words])
        rows = [line.split() for line in table.read_text().splitlines()] if traced else []
        counts = {row[0]: float(row[1]) for row in rows if len(row) == 2 and row[1].isdecimal()}
        counts.pop("total", None)
        return of, recorded_bytes(out), counts


def as_toml(counts: StepCounts) -> str:
    """Return the text of the file of saved counts, without negligible ones."""
    tables = {
        name: {one: round(value, _DIGITS) for one, value in getattr(counts, name).items() if value >= _LEAST}
        for name in KEPT
    }
    return _HEAD + document(tables)


def saved_counts() -> StepCounts | None:
    """Read the saved counts of this Python version, without functions; None if missing."""
    if not TABLE.is_file():
        return None
    content = tomllib.loads(TABLE.read_text())
    return StepCounts(**{field.name: content.get(field.name, {}) for field in fields(StepCounts)})


def differences(now: StepCounts, kept: StepCounts) -> Iterator[str]:
    """Yield a sentence per sum that differs by more than TOLERANCE, with the packages that differ most."""
    for name, words in KEPT.items():
        new, old = getattr(now, name), getattr(kept, name)
        change = sum(new.values()) / sum(old.values()) - 1
        if abs(change) > TOLERANCE:
            yield (
                f"a robot-step has {sum(new.values()):.1f} {words}, {TABLE.name} "
                f"{sum(old.values()):.1f} ({change:+.1%}): {_causes(new, old)}; if intended, run "
                "`acrc bench budget --write` and give the reason in the commit"
            )


def _causes(new: Mapping[str, float], old: Mapping[str, float]) -> str:
    """Return the greatest changes as text."""
    changes = {name: new.get(name, 0.0) - old.get(name, 0.0) for name in {**old, **new}}
    most = sorted(changes, key=lambda name: -abs(changes[name]))[:_NAMED]
    return ", ".join(f"{name} {changes[name]:+.1f}" for name in most if abs(changes[name]) >= 0.05)


_LEAST_S: Final = 3.0
_MAX_CALLED: Final = 25
_SHOWN: Final = 0.05
"""Minimum count per robot-step in the tables."""


def measure(bus: str | None = None, duration: float = SECONDS, write: bool = False) -> BenchmarkResult:
    """Count on one bus, or on both; `duration`: simulated s, of which the first third is not counted.

    `write`: save the counts in memory for this version of Python.
    """
    check_choice("--bus", bus, get_args(Bus))
    if duration < _LEAST_S:
        raise wrong_value("--duration", f"{duration:g}", f"at least {_LEAST_S:g} for budget")
    if write and (bus == "zenoh" or duration != SECONDS):
        raise OptionError("--write: cannot be combined with --bus zenoh or --duration")
    if write:
        clone("acrc bench budget --write")
    say, window = create_console(stderr=True), CountedSteps(duration)
    figures: dict[str, Any] = {"robots": ROBOTS, "from_s": window.first_s, "to_s": window.seconds}
    shown: list[Table | str] = []
    if bus != "zenoh":
        say.print(f"{ROBOTS} robots in memory …")
        found, allocated = count_steps(window), count_blocks(window)
        figures["memory"] = asdict(found) | {"blocks": allocated}
        shown += _memory(found, allocated, saved_counts() if duration == SECONDS else None)
        if write:
            TABLE.write_text(as_toml(found))
            shown.append(f"{TABLE.name} written")
    if bus != "memory":
        say.print(f"{ROBOTS} robots over Zenoh …")
        mesh = count_over_mesh(window)
        figures["zenoh"] = asdict(mesh)
        shown += _mesh(mesh)
    return BenchmarkResult(figures, shown)


def _memory(found: StepCounts, allocated: float, kept: StepCounts | None) -> list[Table | str]:
    tables: list[Table | str] = [
        _table(f"{words} per robot-step, in memory", getattr(found, name), getattr(kept, name, None))
        for name, words in KEPT.items()
    ]
    most = dict(islice(found.functions.items(), _MAX_CALLED))
    tables.insert(1, _table("most frequent functions, calls per robot-step", most, None, whole=False))
    tables.append(f"memory blocks allocated per robot-step, including freed ones: {allocated:.1f}")
    if kept is not None:
        tables += [*differences(found, kept)] or [f"equal to {TABLE.name} within 2 %"]
    return tables


def _mesh(found: MeshCounts) -> list[Table | str]:
    shown: list[Table | str] = [_table("bytes recorded per robot-step, over Zenoh", found.recorded, None)]
    if found.system_calls is None:
        shown.append("system calls not counted: strace is not installed")
    else:
        shown.append(_table("system calls per robot-step, over Zenoh", found.system_calls, None))
    switches = f"{found.voluntary:.1f} voluntary, {found.forced:.1f} forced"
    return [*shown, f"context switches per robot-step, over Zenoh: {switches}"]


def _table(
    title: str, found: Mapping[str, float], kept: Mapping[str, float] | None, *, whole: bool = True
) -> Table:
    """Return a table of current and saved counts by name, with the sum if they are the `whole`."""
    rows = Table("", "now", *(("saved",) if kept is not None else ()), title=title)
    old = kept or {}
    lines = {name: (found.get(name, 0.0), old.get(name, 0.0)) for name in {**found, **old}}
    if whole:
        lines["all"] = (sum(found.values()), sum(old.values()))
    for name, values in lines.items():
        if max(values) >= _SHOWN:
            rows.add_row(name, *(f"{value:.1f}" for value in values[: len(rows.columns) - 1]))
    return rows
