"""What the robots' navigation has been through in a run, from what each robot's process said at its end."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import msgspec

from observation.results.outcome import MOST_LISTED, MOST_NAMES, Count, Metres, Name, told

SUBJECT: Final = "navigation"
"""Under which a robot's last record holds what its navigation counted."""
T = TypeVar("T")
_Listed = Annotated[tuple[T, ...], msgspec.Meta(max_length=MOST_LISTED)]


class GivenGoal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One goal that a behaviour gave to navigation; instants in µs."""

    begin: Count
    """The start of the step in which it was given."""
    x: Metres
    y: Metres
    """Where, m, map frame."""
    end: Count | None = None
    """The start of the step in which it ended; None: pursued at the end of the process."""
    how: Name = ""
    """`succeeded`, `replaced`, `cancelled`, or why navigation gave it up."""


class NavigationOutcome(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one robot's navigation counted, from the start of its process to its end."""

    goals: Count
    succeeded: Count
    cancelled: Count
    recoveries: Count
    retreats: Count
    aborted: Annotated[dict[str, Count], msgspec.Meta(max_length=MOST_NAMES)]
    """By reason."""
    no_valid_trajectory: _Listed[tuple[Count, Count, Literal["itself", "abort", "order", "run"]]]
    """Spells in which the local planner found none: begin and end, µs, and how each ended."""
    no_valid_trajectory_unlisted: Count
    """Further ones."""
    given: _Listed[GivenGoal] = ()
    """Goals, in their order."""
    given_unlisted: Count = 0
    """Further ones."""
    without_plan: _Listed[tuple[Count, Count]] = ()
    """Spells in which no way was found to one goal after the other: begin and end, µs."""
    paused: _Listed[tuple[Count, Count | None]] = ()
    """Spells in which the behaviour had paused navigation: begin and end, µs; None: to the end of the run."""


class NavigationResult(msgspec.Struct, frozen=True):
    """What the navigation of all robots did, over all processes that a robot had."""

    goals: int
    """Points that behaviours asked for, the same one again included."""
    succeeded: int
    """Goals reached."""
    aborted: dict[str, int]
    """Goals that navigation gave up, by reason: "no plan", "blocked" (no valid trajectory for too long) or
    "no progress". The others were replaced or taken back, or open at the end."""
    recoveries: int
    """How often marks farther away were forgotten to try once more."""
    retreats: int
    """How often a robot backed away from what its bumper had touched."""
    no_valid_trajectory: dict[str, int]
    """Spells in which the local planner found no valid trajectory, by how they ended: by "itself", with an
    "abort", with another "order", with the "run", or "unlisted" where there were too many to say."""
    no_valid_trajectory_s: float
    """How long those listed lasted together, s."""


def navigation_outcome(record: Path, outcome: Mapping[str, msgspec.Raw]) -> NavigationOutcome | None:
    """What a process's last record says about its navigation; None if it says nothing."""
    return told(record, outcome, SUBJECT, NavigationOutcome, "a robot's navigation")


def navigation_result(outcomes: Iterable[NavigationOutcome]) -> NavigationResult:
    """What the navigation of all robots did together."""
    counts: Counter[str] = Counter()
    aborted: Counter[str] = Counter()
    spells: Counter[str] = Counter()
    lasted_us = 0
    for outcome in outcomes:
        for name in ("goals", "succeeded", "recoveries", "retreats"):
            counts[name] += getattr(outcome, name)
        aborted.update(outcome.aborted)
        spells.update(ending for _, _, ending in outcome.no_valid_trajectory)
        spells["unlisted"] += outcome.no_valid_trajectory_unlisted
        lasted_us += sum(end - begin for begin, end, _ in outcome.no_valid_trajectory)
    return NavigationResult(
        goals=counts["goals"],
        succeeded=counts["succeeded"],
        aborted=dict(sorted(aborted.items())),
        recoveries=counts["recoveries"],
        retreats=counts["retreats"],
        no_valid_trajectory={ending: count for ending, count in sorted(spells.items()) if count},
        no_valid_trajectory_s=lasted_us / 1_000_000,
    )
