"""The figures of full swarms as a person reads them."""

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.swarm.budget import growth, whole
from benchmarks.swarm.figures import SwarmFigures
from benchmarks.swarm.speed_goals import SpeedGoal
from benchmarks.swarm.task import Range, SwarmTask


def show(
    task: SwarmTask, figures: Sequence[SwarmFigures], goals: Sequence[SpeedGoal], profiles: Mapping[int, str]
) -> None:
    """Print everything."""
    console = Console(width=150)
    console.print(_speeds(figures, task))
    console.print(_budget(figures))
    console.print(_processes(figures))
    console.print(_memory(figures))
    for one in figures:
        memory = one.memory
        net = memory.clocked_ms - memory.clock_ms
        console.print(
            f"{one.robots} robots: the clocks in the parts cost {memory.clock_ms:.2f} of "
            f"{memory.clocked_ms:.2f} ms; without them {net:.2f} is left, and a run without any takes "
            f"{memory.ms:.2f}",
            highlight=False,
        )
    if len(figures) > 1:
        console.print(_growth(figures[0], figures[-1]))
    for count, profile in profiles.items():
        console.print(f"{count} robots in memory, by the functions' own time:", highlight=False)
        console.print(profile, highlight=False, markup=False, soft_wrap=True)
    for goal in goals:
        console.print(
            f"goal, {goal.words}: {goal.figure:.2f}, {'met' if goal.met else 'MISSED'}", highlight=False
        )


def _speeds(figures: Sequence[SwarmFigures], task: SwarmTask) -> Table:
    columns = (
        "simulated s",
        "x real time",
        "in memory",
        "CPU ms",
        "in memory",
        "ping-pong",
        "start s",
        "its CPU s",
        "load",
    )
    table = Table("robots", *columns, "others", "yardstick", title=_title(task))
    for one in figures:
        mesh = one.mesh
        table.add_row(
            str(one.robots),
            f"{one.simulated_s:g}",
            _spread(mesh.real_time_factor, 1),
            f"{one.memory.real_time_factor:.1f}",
            _spread(mesh.ms, 2),
            f"{one.memory.ms:.2f}",
            f"{one.ping_pong_ms:.2f}",
            f"{mesh.startup_s.median:.1f}",
            f"{mesh.startup_cpu_s.median:.1f}",
            f"{one.load:.1f}",
            f"{mesh.others.median:.1f}",
            f"{one.yardstick_ms:.1f}",
        )
    return table


def _title(task: SwarmTask) -> str:
    return (
        f"{task.scenario.name}, over Zenoh: median (least-greatest) of {task.repeat}; "
        "CPU per robot and simulated second;\nothers: cores busy with something else; "
        "yardstick: CPU ms of a fixed piece of work"
    )


def _spread(spread: Range, digits: int) -> str:
    return f"{spread.median:.{digits}f} ({spread.least:.{digits}f}-{spread.greatest:.{digits}f})"


def _budget(figures: Sequence[SwarmFigures]) -> Table:
    """Every line for every number of robots, and what they add up to."""
    title = "CPU by part, ms per robot and simulated second, over Zenoh"
    table = Table("", "part", *(f"{one.robots} robots" for one in figures), title=title)
    by_key = [{(line.actor, line.part): line.ms for line in one.lines} for one in figures]
    actors = dict.fromkeys(line.actor for one in figures for line in one.lines)
    for actor in actors:
        keys = dict.fromkeys(key for table_of in by_key for key in table_of if key[0] == actor)
        rows = [(key[1], [of.get(key, 0.0) for of in by_key]) for key in keys]
        for name, values in sorted(rows, key=lambda row: -row[1][-1]):
            table.add_row("", name, *(f"{value:.3f}" for value in values))
        sums = [whole([line for line in one.lines if line.actor == actor]) for one in figures]
        table.add_row(actor, "all", *(f"{value:.3f}" for value in sums), style="bold")
        table.add_section()
    table.add_row("all", "", *(f"{whole(one.lines):.3f}" for one in figures), style="bold")
    return table


def _processes(figures: Sequence[SwarmFigures]) -> Table:
    title = "processes: CPU ms per robot and simulated second, the kernel's share, context switches"
    table = Table("robots", "kind", "CPU ms", "kernel", "switches per robot and step", title=title)
    for one in figures:
        for actor, ms in one.mesh.by_actor.items():
            share, switches = one.mesh.system[actor], one.mesh.switches[actor]
            table.add_row(str(one.robots), actor, f"{ms:.3f}", f"{share:.0%}", f"{switches:.2f}")
        table.add_section()
    return table


def _memory(figures: Sequence[SwarmFigures]) -> Table:
    table = Table(
        "robots", "kind", "processes", "RSS MB", "PSS MB", "private MB", title="memory, all of a kind"
    )
    for one in figures:
        for name, of in one.mesh.memory.items():
            sizes = (of.rss_mb, of.pss_mb, of.private_mb)
            table.add_row(str(one.robots), name, str(of.processes), *(f"{size:.1f}" for size in sizes))
        total = one.mesh.memory.values()
        sums = (sum(of.pss_mb for of in total), sum(of.private_mb for of in total))
        number = str(sum(of.processes for of in total))
        table.add_row(str(one.robots), "all", number, "", *(f"{size:.1f}" for size in sums), style="bold")
        table.add_section()
    return table


def _growth(few: SwarmFigures, many: SwarmFigures) -> Table:
    """Which part grows with the number of robots."""
    title = f"growth from {few.robots} to {many.robots} robots, per robot and second"
    table = Table("", "part", "ms before", "ms after", "factor", "share of the growth", title=title)
    rows = growth(few.lines, many.lines)
    before, after = whole(few.lines), whole(many.lines)
    sums = (f"{before:.3f}", f"{after:.3f}", f"{after / before:.2f}")
    table.add_row("all", "", *sums, "100%", style="bold")
    for row in rows:
        factor_text = "-" if row.factor is None else f"{row.factor:.2f}"
        table.add_row(
            row.actor, row.part, f"{row.few_ms:.3f}", f"{row.many_ms:.3f}", factor_text, f"{row.share:.0%}"
        )
    return table
