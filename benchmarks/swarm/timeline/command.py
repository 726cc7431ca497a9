"""A timeline of some steps: a run is watched, its picture written, and told what it comes to."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from rich.table import Table

from actors.installation.usage import wrong_value
from actors.messages import AIRED, DRIVE
from actors.runtime.spans import Span
from benchmarks.statistics.measured import Measured, table_of
from benchmarks.swarm.process_figures import KINDS, kind
from benchmarks.swarm.task import SwarmTask
from benchmarks.swarm.timeline import trace_file
from benchmarks.swarm.timeline.trace_file import brief
from benchmarks.swarm.timeline.watching import Watched, watch


def shares(seen: Watched) -> dict[str, Any]:
    """What a timeline comes to: medians over steps, ms.

    `step_ms`: wall clock of a step. `world_waits_ms`: how long the world waits for what, by the end of the
    key. `delivery_ms`: from Senses being sent to the robot's going on. `idle_ms`: core time per step that no
    process of the run used, and its share of all cores' time. `others`: cores busy with something else.
    """
    walls = _walls(seen)
    by_actor = {actor: _by_step(spans) for actor, spans in seen.spans.items()}
    cpu = [sum(_cpu(steps.get(step, ())) for steps in by_actor.values()) for step in walls]
    idle = [seen.cores * wall - used for wall, used in zip(walls.values(), cpu, strict=True)]
    return {
        "robots": seen.robots,
        "steps": len(walls),
        "step_ms": _ms(walls.values()),
        "kinds": [_kind(name, by_actor) for name in KINDS],
        "world_waits_ms": {
            name: _ms(
                sum(_wall(s) for s in spans if s.kind == "wait" and brief(s.missing).endswith(name))
                for spans in by_actor["world"].values()
            )
            for name in (DRIVE.pattern.rpartition("/")[2], AIRED.pattern.rpartition("/")[2])
        },
        "delivery_ms": _ms(_deliveries_ns(seen)),
        "cores": seen.cores,
        "idle_ms": _ms(idle),
        "idle_share": median(i / (seen.cores * w) for i, w in zip(idle, walls.values(), strict=True)),
        "others": seen.others,
        "load": seen.load,
        "slowest": _slowest(by_actor),
    }


def _ms(times_ns: Iterable[float]) -> float:
    """Their median, ms."""
    return median(times_ns) / 1e6


Steps = Mapping[int, Sequence[Span]]


def _by_step(spans: Sequence[Span]) -> dict[int, list[Span]]:
    found: dict[int, list[Span]] = {}
    for span in spans:
        found.setdefault(span.step, []).append(span)
    return found


def _walls(seen: Watched) -> dict[int, int]:
    """By step, from the world's first span to its last, ns."""
    return {
        step: spans[-1].end_ns - spans[0].begin_ns for step, spans in _by_step(seen.spans["world"]).items()
    }


def _kind(name: str, by_actor: Mapping[str, Steps]) -> dict[str, Any]:
    """One kind of process in one step, of robots also the median over robots.

    `works_ms`: from what it waited for to its next wait, by the wall clock: also without a core to run on.
    `works_cpu_ms`: CPU of its main thread in that time. `cpu_ms`: of all processes of the kind, their meshes'
    threads included.
    """
    members = [steps for actor, steps in by_actor.items() if kind(actor) == name]
    each = [spans for steps in members for spans in steps.values()]
    together: Counter[int] = Counter()
    for steps in members:
        together.update({step: _cpu(spans) for step, spans in steps.items()})
    return {
        "kind": name,
        "processes": len(members),
        "works_ms": _ms(map(_works, each)),
        "works_cpu_ms": _ms(sum(s.thread_ns for s in spans if s.kind != "wait") for spans in each),
        "waits_ms": _ms(sum(_wall(s) for s in spans if s.kind == "wait") for spans in each),
        "cpu_ms": _ms(together.values()),
    }


def _slowest(by_actor: Mapping[str, Steps]) -> dict[str, Any]:
    """The robot whose answer comes last most often, in so many `steps`, and how long it works.

    `behind_ms`: how long after the median robot's answer the last one is sent, whoever sends it.
    """
    robots = {actor: steps for actor, steps in by_actor.items() if kind(actor) == KINDS[-1]}
    last, behind = Counter[str](), []
    for step in by_actor["world"]:
        answered = {robot: _answered(steps.get(step, ())) for robot, steps in robots.items()}
        late = max(answered, key=lambda robot: answered[robot])
        last[late] += 1
        behind.append(answered[late] - median(answered.values()))
    robot, steps = last.most_common(1)[0]
    return {
        "robot": robot,
        "steps": steps,
        "behind_ms": _ms(behind),
        "works_ms": _ms(map(_works, robots[robot].values())),
        "robots_work_ms": _ms(_works(spans) for steps in robots.values() for spans in steps.values()),
    }


def _answered(spans: Sequence[Span]) -> int:
    """When its Drive was sent; 0 if it sent none in that step."""
    drive = DRIVE.pattern.rpartition("/")[2]
    return max((s.end_ns for s in spans if s.kind == "send" and s.key.endswith(drive)), default=0)


def _deliveries_ns(seen: Watched) -> list[int]:
    sent = {(s.key, s.number): s.end_ns for s in seen.spans["world"] if s.kind == "send"}
    return [
        span.end_ns - sent[span.key, span.number]
        for actor, spans in seen.spans.items()
        if kind(actor) == KINDS[-1]
        for span in spans
        if span.kind == "wait" and (span.key, span.number) in sent
    ]


def _works(spans: Sequence[Span]) -> int:
    return sum(_wall(span) for span in spans if span.kind != "wait")


def _cpu(spans: Sequence[Span]) -> int:
    return sum(span.process_ns for span in spans)


def _wall(span: Span) -> int:
    return span.end_ns - span.begin_ns


STEPS: Final = 20
"""Steps that are watched; own choice: two simulated seconds, in which each robot has talked twice."""
ROBOTS: Final = 50
SECONDS: Final = 20.0
"""Simulated time of a run, unless it is said; robots have found their ways by its middle."""


def draw(robots: Sequence[int], seconds: float, path: Path, steps: int = STEPS) -> Measured:
    """Watch one swarm and write the file. OptionError for several, and for a file that cannot be made."""
    if len(robots) != 1:
        raise wrong_value("--robots", " ".join(map(str, robots)), "one number with --timeline")
    trace_file.check(path)
    seen = watch(robots[0], SwarmTask(seconds=seconds, robot_seconds=None), steps)
    trace_file.write(seen, path)
    found = shares(seen)
    figures = found | {"digest": seen.digest, "first_step": seen.window.first, "file": str(path)}
    return Measured(figures, _shown(found, seen.window.first, path))


def _shown(found: dict[str, Any], first: int, path: Path) -> tuple[Table | str, ...]:
    title = (
        f"{found['robots']} robots, a step of {found['step_ms']:.1f} ms\n"
        f"ms, medians of {found['steps']} steps from step {first} on"
    )
    table = table_of([{name: _cell(value) for name, value in one.items()} for one in found["kinds"]], title)
    waits = ", ".join(f"{name} {ms:.2f} ms" for name, ms in found["world_waits_ms"].items())
    last = found["slowest"]
    return (
        table,
        f"the world waits for: {waits}; from Senses to a robot that goes on: {found['delivery_ms']:.2f} ms",
        f"idle at the barrier: {found['idle_share']:.0%} of {found['cores']} cores, {found['idle_ms']:.2f} "
        f"ms a step (others were busy on {found['others']:.1f} cores; load before: {found['load']:.1f})",
        f"slowest: {last['robot']}, last in {last['steps']} of {found['steps']} steps; works "
        f"{last['works_ms']:.2f} ms, all robots {last['robots_work_ms']:.2f} ms; the last answer comes "
        f"{last['behind_ms']:.2f} ms after the median one",
        f"{path}: for Perfetto (ui.perfetto.dev) or chrome://tracing",
    )


def _cell(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)
