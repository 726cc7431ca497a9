"""Records of a run's time accounting; docs/concepts.md defines the causes."""

from enum import StrEnum
from typing import Final

import msgspec


class Cause(StrEnum):
    """Cause of a robot's step; the first one that applies counts.

    A waiting robot has a cause that follows from the root of its chain: BY_DEAD if the root is off or frozen,
    DONE_IN_WAY if it is idle, else the root's own cause. Causes that the task declares
    (`TaskDeclaration.causes`) come after FROZEN.
    """

    OFF = "off"
    """Its process has exited."""
    FROZEN = "frozen"
    """Its process is stopped and will continue."""
    IDLE = "idle"
    """It stands and has no items left."""
    LOST = "lost"
    """Its localisation error is too large."""
    STRATEGY_IDLE = "strategy idle"
    """It stands with items left, and its strategy requests no goal."""
    ON_PURPOSE = "waits on purpose"
    """Its strategy has paused navigation and keeps the goal."""
    DEADLOCK = "deadlock"
    """Standing robots wait for each other in a ring."""
    BY_DEAD = "blocked by dead robot"
    """The chain ends at a robot that is off or frozen."""
    DONE_IN_WAY = "done robot in the way"
    """The chain ends at a robot that is idle."""
    CLOSED_DOOR = "closed door"
    """It makes no progress, and a closed door is in the way."""
    UNREACHABLE = "unreachable"
    """It makes no progress, and no path leads to its goal even with all doors open."""
    NO_PLAN = "no plan"
    """Its estimate is in a wall, or navigation finds no path although one exists."""
    LIVELOCK = "livelock"
    """It moves, alone or with others, without progress towards a goal."""
    DOOR = "waiting at a door"
    """The root makes progress, and the chain leads through a door or up to one."""
    OPEN_FLOOR = "blocked on open floor"
    """The root makes progress elsewhere."""
    NO_PROGRESS = "no progress"
    """It stands longer than a turn on the spot takes, for none of these reasons."""
    DRIVING = "driving"
    """None of these."""


BY_ROBOTS: Final = (Cause.DEADLOCK, Cause.BY_DEAD, Cause.DONE_IN_WAY, Cause.DOOR, Cause.OPEN_FLOOR)
"""Causes due to other robots."""


class BlockingEvent(msgspec.Struct, frozen=True):
    """Blocking of two robots."""

    begin_s: float
    end_s: float
    robots: tuple[str, ...]
    x: float
    y: float
    """Midpoint of their last positions, m, map frame."""
    place: str
    """`door` or `open floor`."""
    cause: str
    """Cause with most of their time."""
    at_end: bool
    """It lasted to the end of the run."""


class KnowledgeUse(msgspec.Struct, frozen=True):
    """Knowledge on which a decision is based."""

    source: str
    """Robot that sent it; the robot's own id for its observations."""
    age_s: float
    """Age, s."""


class DecisionEvent(msgspec.Struct, frozen=True):
    """One decision of a robot's adaptation."""

    robot: str
    instant_s: float
    trigger: str
    """Component process or ensemble that decided, such as `AdaptiveCleaningRobot.auto_unblock`."""
    words: str
    """Description of the decision, such as `changes destination`."""
    knowledge: tuple[KnowledgeUse, ...]
    old_goal: tuple[float, float] | None
    """m, map frame; None: none."""
    new_goal: tuple[float, float] | None
    outcome: str
    """`visited` (the new goal), `free`, `blocked again` (after being free), `superseded` (by another
    decision while standing) or `end` (of the run while standing)."""
    blocked_s: float
    """How long it had truly stood at the decision, s."""
    free_after_s: float | None
    """Time from the decision until it truly moved, s; None if it did not, or had not stood."""

    @property
    def adopts(self) -> bool:
        """True if the robot takes over an item of another one, by its words."""
        return "takes over" in self.words


class DiagnosisScore(msgspec.Struct, frozen=True):
    """Agreement of the robots' detection of blocking with ground truth, over all robots of a run."""

    precision: float | None
    """Share of the time detected as blocked that was truly blocked; None: nothing was detected."""
    recall: float | None
    """Share of the truly blocked time that was detected; None: no robot was blocked."""
    delay_s: float | None
    """Median time from the start of a blocking to its detection, s; None: none was detected."""
    spells: int
    """Number of true blockings."""
    noticed: int
    """Number of detected true blockings."""
    false_alarms: int
    """Number of detections without a true blocking."""


class Finding(msgspec.Struct, frozen=True):
    """Observation about a run beyond the causes of single steps."""

    name: str
    """`no contact` or `carried`."""
    robots: tuple[str, ...]
    says: str
    """One sentence."""


class DeadlockCount(msgspec.Struct, frozen=True):
    """Deadlocks of pairs of robots, one of which waits for the other."""

    pairs: int
    came_free: int
    """Pairs whose deadlock was resolved before the end of the run."""


class ChainRoot(msgspec.Struct, frozen=True):
    """Waiting time due to one robot as the root of chains."""

    robot: str
    cause: str
    """Cause of the waiting robots."""
    seconds: float
    """Total waiting time of all robots."""


class TimeSpent(msgspec.Struct, frozen=True):
    """Time accounting of one run by ground truth."""

    robots: dict[str, dict[str, float]]
    """Seconds by robot and cause, also those of the task; those of a robot sum to the run's duration."""
    blockings: tuple[BlockingEvent, ...] = ()
    diagnosis: DiagnosisScore | None = None
    """None: no robot detects blocking."""
    decisions: tuple[DecisionEvent, ...] = ()
    decisions_left_out: int = 0
    """Number of decisions that are not listed."""
    findings: tuple[Finding, ...] = ()
    deadlocks: DeadlockCount | None = None
    """None in records of older versions."""
    blames: tuple[ChainRoot, ...] = ()
    """By robot in scenario order; a deadlock has no root."""
