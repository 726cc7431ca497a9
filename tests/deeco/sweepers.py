"""A typical role, for tests of packet sizes."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated, NamedTuple

from deeco.component import component, role
from deeco.encoding import Resolution
from deeco.knowledge import Knowledge
from deeco.packet import KnowledgePacket, Version, pack
from deeco.schema import RoleRegistry


class Point(NamedTuple):
    x: float
    y: float


class Mode(Enum):
    IDLE = "idle"
    SWEEPING = "sweeping"
    BLOCKED = "blocked"


@dataclass(frozen=True)
class Claim:
    owner: str
    index: int
    place: Point
    term: int


@role
class Sweeper(Knowledge):
    position: Annotated[Point, Resolution(1000)]
    mode: Mode
    goal: Annotated[Claim | None, Resolution(1000)]
    claims: Annotated[tuple[Claim, ...], Resolution(1000)]


@component
class Robot(Sweeper):
    charge: float = 1.0


REGISTRY = RoleRegistry([Sweeper])


def claim(number: int) -> Claim:
    return Claim(f"r{10 + number}", number, Point(31.234 + number, -12.5), 3 + number)


def robot(claims: int) -> Robot:
    return Robot(
        id="r12",
        position=Point(45.123, -12.5),
        mode=Mode.SWEEPING,
        goal=claim(3),
        claims=tuple(claim(number) for number in range(claims)),
    )


def published(claims: int, counter: int = 40_000) -> bytes:
    """Return the L2 packet of a robot with this many claims."""
    value = robot(claims)
    return pack(KnowledgePacket(value.id, Version(3, counter), 0, REGISTRY.pack(value)))
