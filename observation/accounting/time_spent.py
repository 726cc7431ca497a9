"""What is told of where a run's time went; see docs/experiments.md for what each word means."""

from enum import Enum

import msgspec


class Cause(Enum):
    """What a robot's time went into. Where several hold at once, the first of them does."""

    OFF = "off"
    """Its process was ended or frozen."""
    IDLE = "idle"
    """It has nothing left to do, or no goal."""
    LOST = "lost"
    """It holds itself to be somewhere else."""
    NO_PLAN = "no plan"
    """It holds itself to be in a wall, or navigation finds no way to its goal."""
    WEDGED = "wedged"
    """It stands so near to another robot, which does not get on either, that its local planner finds no way
    out."""
    DONE_IN_WAY = "done robot in the way"
    """It stands before a robot that wants nowhere any more, or is off."""
    DOOR = "waiting at a door"
    """It stands in or at a door before another robot that wants to get somewhere."""
    OPEN_FLOOR = "blocked on open floor"
    """The same anywhere else."""
    NO_PROGRESS = "no progress"
    """It stands for longer than a turn on the spot takes, and none of these is why."""
    DRIVING = "driving"
    """None of these: it gets on."""


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
    """As in `radio jammed`."""
    robots: tuple[str, ...]
    says: str
    """One sentence."""


class WedgeCount(msgspec.Struct, frozen=True):
    """Pairs of robots that were wedged."""

    pairs: int
    came_free: int
    """Of them, before the end of the run."""


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
    wedges: WedgeCount = WedgeCount(0, 0)
