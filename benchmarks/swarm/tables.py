"""The figures of swarms as a person reads them."""

from collections.abc import Sequence

from rich.table import Table

from benchmarks.swarm.budget import whole
from benchmarks.swarm.figures import ROBOTS, SpeedGoal, SwarmFigures, memory_mb
from benchmarks.swarm.over_mesh import MeshFigures
from benchmarks.swarm.task import Range, SwarmTask


def shown(task: SwarmTask, swarms: Sequence[SwarmFigures], goals: Sequence[SpeedGoal]) -> list[Table | str]:
    """Everything."""
    meshes = {one.robots: one.mesh for one in swarms if one.mesh}
    tables: list[Table | str] = [_speeds(swarms, task), _budget(swarms), _traffic(swarms)]
    if meshes:
        tables += [_processes(meshes), _memory(meshes)]
    said = [f"goal, {one.words}: {one.figure:.2f}, {'met' if one.met else 'MISSED'}" for one in goals]
    return [*tables, *said]


def _speeds(swarms: Sequence[SwarmFigures], task: SwarmTask) -> Table:
    title = (
        f"{task.scenario.name}, over Zenoh: median (least-greatest) of {task.repeat}; CPU ms per robot and "
        "simulated second;\nothers: cores busy with something else; yardstick: CPU ms of fixed work"
    )
    table = Table(
        *("robots", "simulated s", "x real time", "in memory", "CPU ms", "in memory"),
        *("idle", "idle, in memory", "ping-pong", "start s", "its CPU s", "load", "others", "yardstick"),
        title=title,
    )
    for one in swarms:
        mesh, memory = one.mesh, one.memory
        table.add_row(
            str(one.robots),
            f"{one.simulated_s:g}",
            _spread(mesh.real_time_factor, 1) if mesh else "-",
            f"{memory.real_time_factor:.1f}",
            _spread(mesh.ms, 2) if mesh else "-",
            f"{memory.ms:.2f}",
            f"{one.idle.ms:.2f}" if one.idle else "-",
            f"{one.idle.memory_ms:.2f}" if one.idle else "-",
            f"{one.ping_pong_ms:.2f}",
            f"{mesh.startup_s.median:.1f}" if mesh else "-",
            f"{mesh.startup_cpu_s.median:.1f}" if mesh else "-",
            f"{one.load:.1f}",
            f"{mesh.others.median:.1f}" if mesh else "-",
            f"{one.yardstick_ms:.1f}",
        )
    return table


def _spread(spread: Range, digits: int) -> str:
    return f"{spread.median:.{digits}f} ({spread.least:.{digits}f}-{spread.greatest:.{digits}f})"


def _budget(swarms: Sequence[SwarmFigures]) -> Table:
    """Every line for every number of robots, and what they add up to."""
    title = "CPU by part, ms per robot and simulated second, over Zenoh"
    table = Table("", "part", *(f"{one.robots} robots" for one in swarms), title=title)
    by_key = [{(line.actor, line.part): line.ms for line in one.lines} for one in swarms]
    actors = dict.fromkeys(line.actor for one in swarms for line in one.lines)
    for actor in actors:
        keys = dict.fromkeys(key for table_of in by_key for key in table_of if key[0] == actor)
        rows = [(key[1], [of.get(key, 0.0) for of in by_key]) for key in keys]
        for name, values in sorted(rows, key=lambda row: -row[1][-1]):
            table.add_row("", name, *(f"{value:.3f}" for value in values))
        sums = [whole([line for line in one.lines if line.actor == actor]) for one in swarms]
        table.add_row(actor, "all", *(f"{value:.3f}" for value in sums), style="bold")
        table.add_section()
    table.add_row("all", "", *(f"{whole(one.lines):.3f}" for one in swarms), style="bold")
    return table


def _traffic(swarms: Sequence[SwarmFigures]) -> Table:
    names = ("published", "frames sent", "copies computed", "frames heard", "packets", "news", "no news")
    table = Table("robots", *names, title="the air, per robot and simulated second")
    for one in swarms:
        of = one.traffic
        rates = (of.published, of.frames, of.copies, of.heard, of.packets, of.news, of.stale)
        table.add_row(str(one.robots), *(f"{rate:.2f}" for rate in rates))
    return table


def _processes(meshes: dict[int, MeshFigures]) -> Table:
    title = "processes: CPU ms per robot and simulated second, the kernel's share, context switches"
    table = Table("robots", "kind", "CPU ms", "kernel", "switches per robot and step", title=title)
    for robots, mesh in meshes.items():
        for actor, ms in mesh.by_actor.items():
            share, switches = mesh.system[actor], mesh.switches[actor]
            table.add_row(str(robots), actor, f"{ms:.3f}", f"{share:.0%}", f"{switches:.2f}")
        table.add_section()
    return table


def _memory(meshes: dict[int, MeshFigures]) -> Table:
    columns = ("robots", "kind", "processes", "RSS MB", "PSS MB", "private MB")
    table = Table(*columns, title="memory, all of a kind; a robot: PSS of one")
    for robots, mesh in meshes.items():
        for name, of in mesh.memory.items():
            sizes = (of.rss_mb, of.pss_mb, of.private_mb)
            table.add_row(str(robots), name, str(of.processes), *(f"{size:.1f}" for size in sizes))
        total = mesh.memory.values()
        sums = (sum(of.pss_mb for of in total), sum(of.private_mb for of in total))
        number = str(sum(of.processes for of in total))
        table.add_row(str(robots), "all", number, "", *(f"{size:.1f}" for size in sums), style="bold")
        table.add_row(str(robots), "a robot", "1", "", f"{memory_mb(mesh.memory, ROBOTS):.1f}", "")
        table.add_section()
    return table
