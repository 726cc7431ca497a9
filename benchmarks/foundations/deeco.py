"""What the component model costs: memberships, process activations, and the chapter's robot among peers."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from rich.console import Console
from rich.table import Table

from actors.geometry import Point, Pose
from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.messages import Heard
from actors.robot.behaviour import Behaviour, Goal, GoalStatus, Start, View
from benchmarks.statistics.cpu_time import best
from cleaning.adoption import DestinationAdoption
from cleaning.chapter import behaviour
from cleaning.cleaner import Cleaner, State
from cleaning.place import Assignment
from deeco import component, ensemble, periodic
from deeco.link import Reception
from deeco.node import Node


@dataclass(frozen=True)
class DeecoTask:
    """What is measured."""

    replicas: int = 200
    """Peers whose membership is asked."""
    evaluations: int = 9
    """Evaluations of the ensemble for each repeat, every 3 s, until replicas are forgotten."""
    activations: int = 20_000
    peers: int = 4
    minutes: float = 5.0
    """Simulated, of the chapter's robot."""
    repeats: int = 7
    """The fastest counts."""
    memberships_goal: float = 200_000.0
    """Per CPU second, at least."""
    activation_goal_us: float = 20.0
    """CPU, at most, commit included."""
    robot_goal_ms: float = 0.6
    """CPU per robot-second, at most."""


@component
class Counting(Cleaner):
    """Changes its knowledge with every activation; otherwise of the model problem's size."""

    blocked_for: int = 0
    route: tuple[Assignment, ...] = ()
    still_for: int = 0
    attempt: int = 0
    before: Point | None = None

    @periodic(every=milliseconds(1))
    def count(self) -> Self:
        """One activation, one commit."""
        return replace(self, attempt=self.attempt + 1)


@component
class StandingCleaner(Cleaner):
    """A peer that stands in everybody's way."""


@ensemble(every=seconds(3))
class Lasting(DestinationAdoption):
    """As the original, in which replicas stay for ever."""


def run(json_output: bool = False, task: DeecoTask | None = None) -> dict[str, Any]:
    """Measure, print and give the three figures beside their goals."""
    task = task or DeecoTask()
    memberships, activation, robot = _memberships(task), _activation_us(task), _robot_ms(task)
    figures = {
        "task": asdict(task),
        "memberships_per_cpu_s": memberships,
        "activation_cpu_us": activation,
        "robot_second_cpu_ms": robot,
        "goal_met": memberships >= task.memberships_goal
        and activation <= task.activation_goal_us
        and robot <= task.robot_goal_ms,
    }
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        _print(task, memberships, activation, robot)
    return figures


def _memberships(task: DeecoTask) -> float:
    """DestinationAdoption, asked to its last condition: everybody is blocked, nobody near enough."""
    asked = 2 * task.replicas * task.evaluations

    def work(node: Node) -> None:
        for number in range(1, task.evaluations + 1):
            node.advance(Instant(3_000_000 * number + 1))

    node = _crowd(task)
    work(node)
    counted = node.outcome()["counters"]["memberships"]
    assert counted == asked, f"{counted} memberships were asked; it should be {asked}"
    return asked / best(lambda: _crowd(task), work, task.repeats)


def _crowd(task: DeecoTask) -> Node:
    node = Node([_standing("me", 0.0)], [Lasting(1.5, 1, seconds(10))])
    node.advance(Instant(1))
    heard = [
        Reception(node.now, number, frame.data, -60.0)
        for number in range(task.replicas)
        for frame in Node([_standing(f"p{number}", 2.0 + number)], address=number).advance(Instant(1))
    ]
    node.advance(Instant(2), heard)
    return node


def _standing(name: str, x: float) -> StandingCleaner:
    assignment = Assignment(name, 3, Point(x, 5.0))
    return StandingCleaner(id=name, position=Point(x, 1.0), state=State.BLOCKED, destination=assignment)


def _activation_us(task: DeecoTask) -> float:
    route = tuple(Assignment("r1", index, Point(1.0 * index, 2.0)) for index in range(10))

    def prepare() -> Node:
        return Node([Counting(id="r1", position=Point(1.0, 2.0), route=route)])

    end = Instant(task.activations * 1000)
    return 1e6 * best(prepare, lambda node: node.advance(end), task.repeats) / task.activations


def _robot_ms(task: DeecoTask) -> float:
    """All of it: what is heard, processes, ensembles, publishing."""
    steps = round(task.minutes * 600)
    heard = _peers(task, steps)

    def work(robot: Behaviour) -> None:
        for step in range(steps):
            now = Instant(step * 100_000)
            pose = Pose(10.0 + 0.01 * step, 12.0, 0.0)
            goal = Goal(Point(20.0, 12.0), GoalStatus.ACTIVE)
            robot.advance(View(now, pose, True, goal, heard[step]), Instant(now + 100_000))

    busy = best(lambda: behaviour(_start("r1", 1)), work, task.repeats)
    return 1000 * busy / in_seconds(steps * 100_000)


def _peers(task: DeecoTask, steps: int) -> list[tuple[Heard, ...]]:
    """What is on the air in each step: the peers stand around, blocked, and publish."""
    robots = [behaviour(_start(f"r{number + 2}", number + 2)) for number in range(task.peers)]
    heard = []
    for step in range(steps):
        now = Instant(step * 100_000)
        frames = []
        for number, robot in enumerate(robots):
            view = View(now, Pose(11.0 + number, 12.0, 0.0), False, None, ())
            frames += [
                Heard(frame.instant, number + 2, -60.0, 200, frame.data)
                for frame in robot.advance(view, Instant(now + 100_000)).frames
            ]
        heard.append(tuple(sorted(frames, key=lambda frame: frame.instant)))
    return [(), *heard[:-1]]


def _start(name: str, address: int) -> Start:
    places = tuple(Point(20.0 + number, 12.0) for number in range(10))
    return Start(name, address, 0, Pose(11.0, 12.0, 0.0), places, np.random.default_rng(address))


def _print(task: DeecoTask, memberships: float, activation: float, robot: float) -> None:
    table = Table("measured", "reached", "goal", "", title="the component model, of CPU time")
    rows: Sequence[tuple[str, str, str, bool]] = (
        (
            f"membership evaluations per second, {task.replicas} peers",
            f"{memberships:,.0f}",
            f"at least {task.memberships_goal:,.0f}",
            memberships >= task.memberships_goal,
        ),
        (
            "process activation with commit",
            f"{activation:.1f} µs",
            f"at most {task.activation_goal_us:g} µs",
            activation <= task.activation_goal_us,
        ),
        (
            f"the chapter's robot with {task.peers} peers, per robot-second",
            f"{robot:.3f} ms",
            f"at most {task.robot_goal_ms:g} ms",
            robot <= task.robot_goal_ms,
        ),
    )
    for what, reached, goal, met in rows:
        table.add_row(what, reached, goal, "met" if met else "MISSED")
    Console().print(table)
