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
    count_allocations,
    display_name,
    entries,
    plan_run,
    profile_run,
    recorded_bytes,
    sum_by_package,
)
from actors.console import create_console
from actors.installation.repository import clone
from actors.installation.usage import OptionError, check_choice, wrong_value
from actors.runtime.shell import MemoryBus
from deploy.run import swarm
from deploy.run.options import Bus
from deploy.scenario.tables import toml_document

ROBOTS: Final = 8
SECONDS: Final = 9.0
"""Simulated duration of the longer run, s."""
TABLE: Final = Path(__file__).with_name("python{}.{}.toml".format(*sys.version_info))
"""Saved counts of this version of Python; other versions, which call other functions, may have none."""
TOLERANCE: Final = 0.02
"""Maximum relative difference of a sum from the saved one."""
SAVED_FIELDS: Final = {
    "calls": "Python calls",
    "messages": "messages",
    "sent": "bytes sent",
    "recorded": "bytes recorded",
}
"""Fields of `StepCounts` that are saved and compared, with their descriptions."""
_SEED: Final = 1
_STEPS_PER_SECOND: Final = 10
"""Steps of the scenario per simulated second."""
_OWN_PACKAGE: Final = "acrc_testbed/benchmarks"
"""Package of the counting code, whose calls are excluded."""
_TRACER: Final = "strace"
_MIN_COUNT: Final = 0.0005
_MAX_NAMED: Final = 5
"""Maximum number of packages named per difference."""
_DIGITS: Final = 3
_HEADER: Final = (
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
        """Start of the counted steps, simulated s (integral)."""
        return float(self.seconds // 3)

    @property
    def tasks(self) -> tuple[SwarmTask, ...]:
        """The shorter run and the longer one."""
        lengths_s = (self.first_s, self.seconds)
        return tuple(SwarmTask((ROBOTS,), length_s, None, seed=_SEED) for length_s in lengths_s)

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
    short, long = map(_profile_counts, window.tasks)
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


def _profile_counts(task: SwarmTask) -> StepCounts:
    """Count one complete run, from planning to the result."""
    bus = _CountingBus()
    profile, recorded = profile_run(ROBOTS, task, bus)
    called = entries(profile)
    functions: defaultdict[str, float] = defaultdict(float)
    for function, (times, _) in called.items():
        functions[display_name(function)] += times
    packages = {
        name: times for name, times in sum_by_package(called).items() if not name.startswith(_OWN_PACKAGE)
    }
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
    plain = [_count_mesh_run(task) for task in window.tasks]
    switches = window.per_step(
        *({"voluntary": cost.voluntary, "forced": cost.forced} for cost, _, _ in plain)
    )
    traced = None
    if shutil.which(_TRACER):
        traced = window.per_step(*(_count_mesh_run(task, traced=True)[2] for task in window.tasks))
    recorded = window.per_step(*(sizes for _, sizes, _ in plain))
    return MeshCounts(traced, switches["voluntary"], switches["forced"], recorded)


def _count_mesh_run(
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
        cost = run_timed([*tracer, *ACRC, *words])
        rows = [line.split() for line in table.read_text().splitlines()] if traced else []
        counts = {row[0]: float(row[1]) for row in rows if len(row) == 2 and row[1].isdecimal()}
        counts.pop("total", None)
        return cost, recorded_bytes(out), counts


def counts_text(counts: StepCounts) -> str:
    """Return the text of the file of saved counts, without negligible ones; some are negative."""
    tables = {
        name: {
            one: round(value, _DIGITS)
            for one, value in getattr(counts, name).items()
            if abs(value) >= _MIN_COUNT
        }
        for name in SAVED_FIELDS
    }
    return _HEADER + toml_document(tables)


def saved_counts() -> StepCounts | None:
    """Read the saved counts of this Python version, without functions; None if missing."""
    if not TABLE.is_file():
        return None
    content = tomllib.loads(TABLE.read_text())
    return StepCounts(**{field.name: content.get(field.name, {}) for field in fields(StepCounts)})


def differences(now: StepCounts, saved: StepCounts) -> Iterator[str]:
    """Yield a sentence per sum that differs by more than TOLERANCE, with the packages that differ most."""
    for name, words in SAVED_FIELDS.items():
        new, old = getattr(now, name), getattr(saved, name)
        change = sum(new.values()) / sum(old.values()) - 1
        if abs(change) > TOLERANCE:
            yield (
                f"a robot-step has {sum(new.values()):.1f} {words}, {TABLE.name} "
                f"{sum(old.values()):.1f} ({change:+.1%}): {_change_text(new, old)}; if intended, run "
                "`acrc bench budget --write` and give the reason in the commit"
            )


def _change_text(new: Mapping[str, float], old: Mapping[str, float]) -> str:
    """Return the greatest changes as text."""
    changes = {name: new.get(name, 0.0) - old.get(name, 0.0) for name in {**old, **new}}
    largest = sorted(changes, key=lambda name: -abs(changes[name]))[:_MAX_NAMED]
    return ", ".join(f"{name} {changes[name]:+.1f}" for name in largest if abs(changes[name]) >= 0.05)


_MIN_DURATION_S: Final = 3.0
_MAX_CALLED: Final = 25
_MIN_SHOWN: Final = 0.05
"""Minimum count per robot-step in the tables."""


def measure(bus: str | None = None, duration: float = SECONDS, write: bool = False) -> BenchmarkResult:
    """Count on one bus, or on both; `duration`: simulated s, of which the first third is not counted.

    `write`: save the counts in memory for this version of Python.
    """
    check_choice("--bus", bus, get_args(Bus))
    if duration < _MIN_DURATION_S:
        raise wrong_value("--duration", f"{duration:g}", f"at least {_MIN_DURATION_S:g} for budget")
    if write and (bus == "zenoh" or duration != SECONDS):
        raise OptionError("--write: cannot be combined with --bus zenoh or --duration")
    if write:
        clone("acrc bench budget --write")
    console, window = create_console(stderr=True), CountedSteps(duration)
    figures: dict[str, Any] = {"robots": ROBOTS, "from_s": window.first_s, "to_s": window.seconds}
    output: list[Table | str] = []
    if bus != "zenoh":
        console.print(f"{ROBOTS} robots in memory …")
        counts, allocated = count_steps(window), count_blocks(window)
        figures["memory"] = asdict(counts) | {"blocks": allocated}
        output += _memory_output(counts, allocated, saved_counts() if duration == SECONDS else None)
        if write:
            TABLE.write_text(counts_text(counts))
            output.append(f"{TABLE.name} written")
    if bus != "memory":
        console.print(f"{ROBOTS} robots over Zenoh …")
        mesh = count_over_mesh(window)
        figures["zenoh"] = asdict(mesh)
        output += _mesh_output(mesh)
    return BenchmarkResult(figures, output)


def _memory_output(counts: StepCounts, allocated: float, saved: StepCounts | None) -> list[Table | str]:
    tables: list[Table | str] = [
        _table(f"{words} per robot-step, in memory", getattr(counts, name), getattr(saved, name, None))
        for name, words in SAVED_FIELDS.items()
    ]
    most_called = dict(islice(counts.functions.items(), _MAX_CALLED))
    tables.insert(1, _table("most frequent functions, calls per robot-step", most_called, None, whole=False))
    tables.append(f"memory blocks allocated per robot-step, including freed ones: {allocated:.1f}")
    if saved is not None:
        tables += [*differences(counts, saved)] or [f"equal to {TABLE.name} within 2 %"]
    return tables


def _mesh_output(counts: MeshCounts) -> list[Table | str]:
    output: list[Table | str] = [_table("bytes recorded per robot-step, over Zenoh", counts.recorded, None)]
    if counts.system_calls is None:
        output.append("system calls not counted: strace is not installed")
    else:
        output.append(_table("system calls per robot-step, over Zenoh", counts.system_calls, None))
    switches = f"{counts.voluntary:.1f} voluntary, {counts.forced:.1f} forced"
    return [*output, f"context switches per robot-step, over Zenoh: {switches}"]


def _table(
    title: str, counts: Mapping[str, float], saved: Mapping[str, float] | None, *, whole: bool = True
) -> Table:
    """Return a table of current and saved counts by name, with their sum if they are all counts (`whole`)."""
    rows = Table("", "now", *(("saved",) if saved is not None else ()), title=title)
    old = saved or {}
    lines = {name: (counts.get(name, 0.0), old.get(name, 0.0)) for name in {**counts, **old}}
    if whole:
        lines["all"] = (sum(counts.values()), sum(old.values()))
    for name, values in lines.items():
        if max(values) >= _MIN_SHOWN:
            rows.add_row(name, *(f"{value:.1f}" for value in values[: len(rows.columns) - 1]))
    return rows
