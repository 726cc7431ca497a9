"""What one run shows of the chapter's three failures."""

from dataclasses import dataclass
from typing import Final

_ITSELF: Final = "itself"
"""How a spell without a valid trajectory ended that resolved."""


@dataclass(frozen=True)
class LostEpisode:
    """A robot that was lost."""

    robot: str
    begin_s: float
    end_s: float
    at_end: bool
    """It was at the end of the run."""


@dataclass(frozen=True)
class Spell:
    """A while in which a robot's driver found no valid trajectory."""

    robot: str
    begin_s: float
    end_s: float
    ended_by: str
    """As in NavigationOutcome."""
    nearest: float | None
    """How near another robot came meanwhile, centre to centre, m; None without others."""

    @property
    def resolved(self) -> bool:
        """True if it passed by itself."""
        return self.ended_by == _ITSELF


@dataclass(frozen=True)
class BlockingEpisode:
    """Robots that stood in each other's way."""

    robots: tuple[str, ...]
    begin_s: float
    end_s: float
    at_end: bool
    """They did to the end of the run; otherwise it resolved."""
    x: float
    y: float
    """The middle of them at its end, m, map frame."""
    passage: bool
    """One of them stood in or just before a door or narrow passage, which one robot closes (see Passages)."""


@dataclass(frozen=True)
class FailureRun:
    """What came about in one run."""

    robots: int
    seed: int
    simulated_s: float
    lost: tuple[LostEpisode, ...]
    lost_share: float | None
    """Share of the robots' time with an error above the threshold; None if no robot said where it holds
    itself to be."""
    lost_at_end: int
    """Robots."""
    spells: tuple[Spell, ...] | None
    """None if no robot's navigation says anything."""
    spells_unlisted: int
    blockings: tuple[BlockingEpisode, ...]
    restless_blockings: tuple[BlockingEpisode, ...]
    """The same if robots that move a little count as standing, too (EpisodeParameters.restless)."""
    blocked_at_end: int
    """Robots in a blocking at the end."""
    aborted: dict[str, int]
    """Goals that navigation gave up, by reason."""
    goals: int
    places: int
    left: int
    """Places not truly visited and reported by the end."""
    contacts: int
    digest: str
    motion: str
    """Hash of the robots' true tracks: equal for runs in which the same happened."""
