"""What is told of where a run's time went; see docs/experiments.md for what each word means."""

from enum import Enum
from typing import Final

import msgspec


class Cause(Enum):
    """What a robot's time went into. Where several hold at once, the first of them does.

    Who waits for another robot has the cause for which the last one of the chain does not get on: if that is
    off or frozen, BY_DEAD; if it is idle, DONE_IN_WAY; else what it has itself.
    """

    OFF = "off"
    """Its process has ended."""
    FROZEN = "frozen"
    """Its process is stopped, and goes on later."""
    IDLE = "idle"
    """It stands, and has nothing left to do."""
    LOST = "lost"
    """It holds itself to be somewhere else."""
    STRATEGY_IDLE = "strategy idle"
    """It stands with places left, and its strategy asks for no goal."""
    ON_PURPOSE = "waits on purpose"
    """Its strategy has paused navigation and keeps the goal, whether or not anything is in the way."""
    DEADLOCK = "deadlock"
    """Robots that stand wait for one another in a ring."""
    BY_DEAD = "blocked by dead robot"
    """The chain ends at a robot that is off or frozen."""
    DONE_IN_WAY = "done robot in the way"
    """The chain ends at a robot that is idle."""
    CLOSED_DOOR = "closed door"
    """It does not get on, and a door that was closed is in its way."""
    UNREACHABLE = "unreachable"
    """It does not get on, and no way leads to its goal, whichever doors are open."""
    NO_PLAN = "no plan"
    """It holds itself to be in a wall, or navigation finds no way although there is one."""
    LIVELOCK = "livelock"
    """It moves, alone or with others, and makes no way towards its goals."""
    DOOR = "waiting at a door"
    """The chain ends at a robot that gets on, and leads through a door or up to one."""
    OPEN_FLOOR = "blocked on open floor"
    """The same anywhere else."""
    NO_PROGRESS = "no progress"
    """It stands for longer than a turn on the spot takes, and none of these is why."""
    DRIVING = "driving"
    """None of these: it gets on."""


BY_ROBOTS: Final = (Cause.DEADLOCK, Cause.BY_DEAD, Cause.DONE_IN_WAY, Cause.DOOR, Cause.OPEN_FLOOR)
"""Another robot is why."""


class BlockingEvent(msgspec.Struct, frozen=True):
    """Robots that stood in each other's way, from the first instant to the last."""

    begin_s: float
    end_s: float
    robots: tuple[str, ...]
    x: float
    y: float
    """The middle of them where they stood last, m, map frame."""
    place: str
    """`door` or `open floor`."""
    cause: str
    """Of `Cause`: the one that most of their time went into."""
    at_end: bool
    """It lasted to the end of the run."""


class KnowledgeUsed(msgspec.Struct, frozen=True):
    """What a decision was made from."""

    source: str
    """The robot that said it; the own id for what the robot itself saw."""
    age_s: float
    """How old it was, s."""


class DecisionEvent(msgspec.Struct, frozen=True):
    """One decision of a robot's adaptation."""

    robot: str
    instant_s: float
    trigger: str
    """The process or the ensemble that decided, as in `AdaptiveCleaningRobot.auto_unblock`."""
    words: str
    """What it decided, as in `turns elsewhere`."""
    knowledge: tuple[KnowledgeUsed, ...]
    old_goal: tuple[float, float] | None
    """m, map frame; None: none."""
    new_goal: tuple[float, float] | None
    outcome: str
    """`visited` the new goal; got `free`; was free and `blocked again`; `overtaken` by another decision while
    it stood; or still stood at the `end` of the run."""
    blocked_s: float
    """How long it truly had stood by then, s; 0 if it got on."""
    free_after_s: float | None
    """From the decision until the robot truly got on, s; None if it did not, or had not stood."""

    @property
    def adopts(self) -> bool:
        """True if the robot takes over a place of another one, in the words of `CleaningRobot`."""
        return "takes over" in self.words


class DiagnosisScore(msgspec.Struct, frozen=True):
    """How well the robots' own word "blocked" agrees with the truth, over all robots of the run."""

    precision: float | None
    """Share of the time said to be blocked that was; None if nothing was said."""
    recall: float | None
    """Share of the time blocked that was said to be; None if no robot was."""
    delay_s: float | None
    """Median time from the beginning of a blocked spell until it was said, s; None if none was."""
    spells: int
    """Times that a robot was blocked."""
    noticed: int
    """Of them, those that were said at all."""
    false_alarms: int
    """Times that a robot said so while it was not."""


class Finding(msgspec.Struct, frozen=True):
    """Something that holds of the run and not of a robot's second."""

    name: str
    """`no contact` or `carried`."""
    robots: tuple[str, ...]
    says: str
    """One sentence."""


class DeadlockCount(msgspec.Struct, frozen=True):
    """Pairs of robots in the ring of a deadlock, one of which waits for the other."""

    pairs: int
    came_free: int
    """Of them, before the end of the run."""


class Blame(msgspec.Struct, frozen=True):
    """A robot at which chains ended."""

    robot: str
    cause: str
    """Of `Cause`: what those had that waited."""
    seconds: float
    """Of all that waited, together."""


class TimeSpent(msgspec.Struct, frozen=True):
    """Where the time of one run went, by ground truth."""

    robots: dict[str, dict[str, float]]
    """Robot, cause (the values of `Cause`, all of them), s; a robot's add up to the run's time."""
    blockings: tuple[BlockingEvent, ...] = ()
    diagnosis: DiagnosisScore | None = None
    """None if no robot has said how it holds itself to be."""
    decisions: tuple[DecisionEvent, ...] = ()
    decisions_left_out: int = 0
    """Made, and not listed."""
    findings: tuple[Finding, ...] = ()
    deadlocks: DeadlockCount | None = None
    """None in records from before they were counted."""
    blames: tuple[Blame, ...] = ()
    """In the order of the scenario's robots; a deadlock has none."""
