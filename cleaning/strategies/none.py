"""The naive solution: each robot visits its places in order and ignores the others.

Idea: baseline without adaptation. Source: the chapter's Fig. 7.2, and CleanerRobot of
d3scomp/deeco-adaptation-testbed. Limits: two robots that meet in a narrow passage stand until the end.
Settings: `CleaningParameters`. Variants after an aborted goal: `none` requests it again, `none-original`
never, `none-giving-up` up to ten times.
"""

from dataclasses import dataclass

from actors.robot.behaviour import Behaviour, Start, from_settings, host
from cleaning.parameters import CleaningParameters
from cleaning.robot import CleaningRobot


@dataclass(frozen=True)
class OriginalParameters(CleaningParameters):
    """Parameters of the released code."""

    retry: bool = False
    """As in the code: a robot whose goal is aborted stands until the end of the run."""


@dataclass(frozen=True)
class PlainGivingUpParameters(CleaningParameters):
    """Parameters with limited attempts, so that all places are "done or given up" (chapter, 7.2.2)."""

    no_plan_attempts: int = 3
    """Own choice: the map does not change."""
    aborted_attempts: int = 10
    """Own choice: one to two minutes in front of a standing robot."""


def behaviour(start: Start) -> Behaviour:
    """Visit places in order, ignore other robots, and repeat aborted goals: the chapter's baseline."""
    return _plain(start, CleaningParameters)


def original(start: Start) -> Behaviour:
    """Visit places in order as the original does: never repeat an aborted goal."""
    return _plain(start, OriginalParameters)


def giving_up(start: Start) -> Behaviour:
    """Visit places in order; give a place up after ten aborts in a row."""
    return _plain(start, PlainGivingUpParameters)


def _plain(start: Start, kind: type[CleaningParameters]) -> Behaviour:
    return host(start, CleaningRobot.at_start(start, from_settings(kind, start.settings)))
