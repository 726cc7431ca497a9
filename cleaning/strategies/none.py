"""The naive solution: every robot visits its places in the order given, and takes no notice of the others.

Idea: what comes of it without any adaptation. Source: the chapter's Fig. 7.2, and CleanerRobot of
d3scomp/deeco-adaptation-testbed. Limits: two robots that meet where only one has room stand for good.
Settings: `CleaningParameters`. Three kinds, which differ in what follows once navigation has given a goal
up: `none` asks for it again, `none-original` never does, `none-giving-up` asks for it ten times.
"""

from dataclasses import dataclass

from actors.robot.behaviour import Behaviour, Start, host
from cleaning.parameters import CleaningParameters
from cleaning.robot import CleaningRobot
from cleaning.settings import from_settings


@dataclass(frozen=True)
class OriginalParameters(CleaningParameters):
    """As the released code has it."""

    retry: bool = False
    """As in the code: who has lost a goal stands to the end of the run."""


@dataclass(frozen=True)
class PlainGivingUpParameters(CleaningParameters):
    """What is tried in vain often enough is given up, so that "done or given up" happens (chapter, 7.2.2)."""

    no_plan_attempts: int = 3
    """Own choice: the map does not change."""
    aborted_attempts: int = 10
    """Own choice: one to two minutes in front of somebody who stands."""


def behaviour(start: Start) -> Behaviour:
    """Visit the own places in their order, whatever the others do, for ever: the chapter's baseline."""
    return _plain(start, CleaningParameters)


def original(start: Start) -> Behaviour:
    """The same as the original did: a goal that navigation gave up once is never asked for again."""
    return _plain(start, OriginalParameters)


def giving_up(start: Start) -> Behaviour:
    """The same, but a place is given up once navigation has given it up ten times in a row."""
    return _plain(start, PlainGivingUpParameters)


def _plain(start: Start, kind: type[CleaningParameters]) -> Behaviour:
    return host(start, CleaningRobot.at_start(start, from_settings(kind, start.settings)))
