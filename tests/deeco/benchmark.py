"""Cost of a node: `python -m tests.deeco.benchmark` prints CPU times in µs, the minima of many repeats.

Packets: frames of 63 bytes, one packet each, from 20 neighbours in turn; the role has position, mode, goal
and one claim. "Other hops": relays change the hop count of each copy. Idle: a step of 100 ms without received
frames, mean over ten seconds; a component with one process, three ensembles and replicas; process, ensembles
and publication are due once per second. Evaluation: of one ensemble with components in a grid, 2 m apart;
members are up to 3 m apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import process_time
from timeit import repeat
from typing import Final, Self

from deeco import Instant, component, ensemble, milliseconds, periodic, seconds
from deeco.fragments import CHECKSUM, HEADER, Fragmenter
from deeco.knowledge import role_fields
from deeco.link import Reception
from deeco.network import NetworkParameters
from deeco.node import Node
from deeco.packet import increment_hops
from tests.deeco.sweepers import Point, Sweeper, robot

NEIGHBOURS: Final = 20
REPEATS: Final = 30
BATCHES: Final = 20
"""Batches of frames per repeat; a batch has one frame of each neighbour."""
FOREVER: Final = seconds(1_000_000)
"""No replica is dropped."""


@component
class Patroller(Sweeper):
    @periodic(every=seconds(1))
    def wait(self) -> Self:
        return self


PATROLLER: Final = Patroller(id="me", **{name: getattr(robot(1), name) for name in role_fields(Sweeper)[1:]})


def are_near(first: Sweeper, second: Sweeper, limit: float) -> bool:
    x, y = first.position.x - second.position.x, first.position.y - second.position.y
    return x * x + y * y < limit * limit


@ensemble(every=seconds(1))
class Blocking:
    def membership(self, coordinator: Sweeper, member: Patroller) -> bool:
        return are_near(coordinator, member, 1.0)


@ensemble(every=seconds(1))
class Avoidance:
    def membership(self, coordinator: Sweeper, member: Patroller) -> bool:
        return are_near(coordinator, member, 3.0)


@ensemble(every=seconds(1))
class Handover:
    def membership(self, coordinator: Sweeper, member: Patroller) -> bool:
        return coordinator.goal is not None and coordinator.goal == member.goal


def publications(times: int, neighbours: int = NEIGHBOURS) -> list[list[Reception]]:
    """Return the frames of all neighbours, second by second."""
    nodes = [Node([replace(robot(1), id=f"r{number}")]) for number in range(neighbours)]
    return [
        [
            Reception(frame.instant, number, frame.data, -70.0)
            for number, node in enumerate(nodes)
            for frame in node.advance(Instant(seconds(second)))
        ]
        for second in range(1, times + 1)
    ]


def listener(neighbours: int = NEIGHBOURS, ensembles: Sequence[object] = ()) -> Node:
    """Return a node with replicas of all neighbours."""
    node = Node([PATROLLER], ensembles, parameters=NetworkParameters(forget_after=FOREVER))
    node.advance(node.now, *publications(1, neighbours))
    return node


def microseconds(run: Callable[[], object], parts: int) -> float:
    """Return the minimum time of a run, divided by the number of its parts."""
    return min(repeat(run, timer=process_time, number=1, repeat=REPEATS)) / parts * 1e6


def packet(batches: Sequence[Sequence[Reception]]) -> float:
    """Return the time per packet of a node that receives these batches."""
    node, left = listener(), iter(batches)

    def receive() -> None:
        for _ in range(BATCHES):
            node.advance(node.now, next(left))

    return microseconds(receive, BATCHES * NEIGHBOURS)


def known_packet(hops: Sequence[int]) -> float:
    """Return the time per packet without news; the hop counts of the batches alternate."""
    (heard,) = publications(1)
    return packet(
        [
            [one._replace(data=relayed(one.data, hops[batch % len(hops)])) for one in heard]
            for batch in range(BATCHES * REPEATS)
        ]
    )


def relayed(frame: bytes, hops: int) -> bytes:
    """Return a new frame with the packet of another one after some relays."""
    data = frame[HEADER.size : -CHECKSUM.size]
    for _ in range(hops):
        data = increment_hops(data)
    (made,) = Fragmenter(99).frames([data])
    return made


def idle_step(neighbours: int) -> float:
    node = listener(neighbours, [Blocking(), Avoidance(), Handover()])

    def wait() -> None:
        for _ in range(100):
            node.advance(Instant(node.now + milliseconds(100)))

    return microseconds(wait, 100)


@ensemble(every=seconds(1), near=("position", 3.0))
class NearAvoidance(Avoidance):
    """Avoidance with its condition declared."""


def evaluation(components: int, kind: object) -> float:
    """Return the time per component to evaluate an ensemble of components 2 m apart, all in one node."""
    side = components // 10
    values = [
        replace(PATROLLER, id=f"r{number}", position=Point(2.0 * (number % side), 2.0 * (number // side)))
        for number in range(components)
    ]
    node = Node(values, [kind], parameters=NetworkParameters(publish_every=FOREVER))

    def evaluate() -> None:
        node.advance(Instant(node.now + seconds(1)))

    return microseconds(evaluate, components)


if __name__ == "__main__":
    news = packet(publications(BATCHES * REPEATS + 1)[1:])
    print(f"packet with news                 {news:8.2f}")
    print(f"packet without news, same hops   {known_packet([0]):8.2f}")
    print(f"packet without news, other hops  {known_packet([1, 2, 3]):8.2f}")
    for number in (20, 256):
        print(f"idle step, {number:3} replicas          {idle_step(number):8.2f}")
    for number in (100, 200, 400):
        all_pairs, near = evaluation(number, Avoidance()), evaluation(number, NearAvoidance())
        print(f"evaluation per component of {number} {all_pairs:8.2f}  with near: {near:.2f}")
