"""What nodes send one another: the published knowledge of one component, in one version."""

from dataclasses import dataclass
from typing import NamedTuple


class Version(NamedTuple):
    """How new knowledge is; compares as it should, so that a node that was restarted is heard again."""

    epoch: int
    """How often the component's node has been restarted."""
    counter: int
    """Publications in this epoch."""


@dataclass(frozen=True)
class KnowledgePacket:
    """One publication of one component."""

    component: str
    version: Version
    hops: int
    """How often it has been relayed."""
    roles: tuple[tuple[int, tuple[object, ...]], ...]
    """For each role that the component plays: the role's fingerprint and its packed fields."""
