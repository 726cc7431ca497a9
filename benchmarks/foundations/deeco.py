"""What the component model costs: memberships, activations, packets, and the chapter's robot among peers."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Self

import numpy as np

from actors.geometry import Point, Pose
from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.messages import Heard
from actors.robot.behaviour import Behaviour, Goal, GoalStatus, Start, View
from benchmarks.statistics.measured import Measured, at_least, at_most
from benchmarks.statistics.runs import best
from cleaning.adoption import DestinationAdoption
from cleaning.cleaner import Cleaner, State
from cleaning.place import Assignment
from cleaning.strategies.chapter import behaviour
from deeco import component, ensemble, periodic
from deeco.link import Reception
from deeco.node import Node
from deeco.replication.network import NetworkParameters, RelayParameters


@dataclass(frozen=True)
class DeecoTask:
    """What is measured."""

    replicas: int = 200
    """Peers whose membership is asked."""
    evaluations: int = 9
    """Evaluations of the ensemble for each repeat, every 3 s, until replicas are forgotten."""
    activations: int = 20_000
    peers: int = 4
    senders: int = 50
    """Peers whose packets are heard, each once and then passed on by others."""
    publications: int = 40
    """Of each."""
    minutes: float = 5.0
    """Simulated, of the chapter's robot."""
    repeats: int = 7
    """The fastest counts."""
    memberships_goal: float = 200_000.0
    """Per CPU second, at least."""
    activation_goal_us: float = 20.0
    """CPU, at most, commit included."""
    fresh_goal_us: float = 15.0
    """CPU for a packet of news, at most, with a relay planned."""
    stale_goal_us: float = 3.0
    """CPU for a packet that is known, at most."""
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


def measure(task: DeecoTask | None = None) -> Measured:
    """The figures beside their goals."""
    task = task or DeecoTask()
    memberships, activation, robot = _memberships(task), _activation_us(task), _robot_ms(task)
    fresh, stale = _packets_us(task)
    peers = f"membership evaluations per CPU second, {task.replicas} peers"
    robot_ms = f"CPU ms per second of the chapter's robot with {task.peers} peers"
    goals = (
        at_least(peers, memberships, task.memberships_goal),
        at_most("CPU µs of a process activation with commit", activation, task.activation_goal_us),
        at_most("CPU µs of a packet of news, with a relay planned", fresh, task.fresh_goal_us),
        at_most("CPU µs of a packet of what is known", stale, task.stale_goal_us),
        at_most(robot_ms, robot, task.robot_goal_ms),
    )
    figures = {
        "task": asdict(task),
        "memberships_per_cpu_s": memberships,
        "activation_cpu_us": activation,
        "fresh_packet_cpu_us": fresh,
        "stale_packet_cpu_us": stale,
        "robot_second_cpu_ms": robot,
        "goal_met": all(goal.met for goal in goals),
    }
    return Measured(figures, tuple(map(str, goals)))


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


def _packets_us(task: DeecoTask) -> tuple[float, float]:
    """CPU for a packet of news, and for one that others pass on of what is known, µs."""
    published = _published(task)
    copies, count = 3, task.senders * task.publications
    parameters = NetworkParameters(relay=RelayParameters())

    def seconds_with(times: int) -> float:
        def prepare() -> tuple[Node, list[list[Reception]]]:
            return Node([_standing("me", 0.0)], parameters=parameters), _heard(published, times)

        def listen(prepared: tuple[Node, list[list[Reception]]]) -> None:
            node, rounds = prepared
            for heard in rounds:
                node.advance(Instant(heard[0].instant + 1), heard)

        return best(prepare, listen, task.repeats)

    news = seconds_with(1)
    return 1e6 * news / count, 1e6 * (seconds_with(1 + copies) - news) / (count * copies)


def _heard(published: Sequence[Sequence[bytes]], times: int) -> list[list[Reception]]:
    """In each second every frame so many times, each time from another sender."""
    return [
        [
            Reception(Instant(number * 1_000_000 + 1), 1000 * time + sender, frame, -60.0)
            for time in range(1, times + 1)
            for sender, frame in enumerate(frames)
        ]
        for number, frames in enumerate(published)
    ]


def _published(task: DeecoTask) -> list[list[bytes]]:
    """The frames of each second."""
    peers = [Node([_standing(f"p{one}", 2.0 + one)], address=one + 2) for one in range(task.senders)]
    return [
        [frame.data for peer in peers for frame in peer.advance(Instant(number * 1_000_000 + 1))]
        for number in range(task.publications)
    ]


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
