"""Reports of robots about themselves: counted if well formed, else named."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.runtime.message_counts import MessageHash
from actors.runtime.process import FinalNote
from observation.results.outcome import Outcomes, means
from observation.results.result import RobotReports, robot_reports

RECORD = Path("out/r1/r1.mcap")
NAVIGATION: dict[str, Any] = {
    "goals": 3,
    "succeeded": 1,
    "cancelled": 1,
    "recoveries": 2,
    "retreats": 0,
    "aborted": {"blocked": 1, "no plan": 0, "no progress": 0},
    "no_valid_trajectory": [[1_000_000, 2_000_000, "abort"]],
    "no_valid_trajectory_unlisted": 0,
    "given": [{"begin": 0, "x": 1.0, "y": 2.0, "end": 100_000, "how": "replaced"}],
    "given_unlisted": 0,
    "without_plan": [[0, 100_000]],
    "paused": [[0, 100_000], [200_000, None]],
}
NODE: dict[str, Any] = {
    "counters": {"published": 20, "frames_sent": 20, "packets": 30},
    "exchanges": {"Adoption": 2},
    "replica_age_ms": {"50": 3},
}


def reports(
    navigation: object = None, node: object = None, unread: int = 0, own: dict[str, Any] | None = None
) -> RobotReports:
    said = {"navigation": navigation or NAVIGATION, "deeco": node or NODE, "adaptation": {}, **(own or {})}
    final = FinalNote(
        MessageHash().digest("r1"), 0, 5, unread, 1.0, 0.5, 0.0, 1.0, {}, {"swarm/down/r1/senses": 5},
        {name: msgspec.Raw(json.dumps(value).encode()) for name, value in said.items()},
    )  # fmt: skip
    return robot_reports([("r1", RECORD, final)])


def test_valid_reports_are_counted() -> None:
    told = reports(unread=5)
    assert told.refused == ()
    assert (told.navigation.goals, told.deeco.counters["packets"], told.unread) == (3, 30, 5)


FORMLESS = (
    NAVIGATION | {"goals": -1},
    NAVIGATION | {"goals": 1.5},
    NAVIGATION | {"goals": 1 << 60},
    NAVIGATION | {"goals": "many"},
    NAVIGATION | {"applause": 1},
    NAVIGATION | {"given": [{"begin": 0, "x": 1e300, "y": 0.0}]},
    NAVIGATION | {"given": [{"begin": 0, "x": float("nan"), "y": 0.0}]},
    NAVIGATION | {"without_plan": [[0, 0]] * 10_001},
    NAVIGATION | {"no_valid_trajectory": [[0, 1, "magic"]]},
    {"goals": 1},
    [NAVIGATION],
)


@pytest.mark.parametrize("told", FORMLESS, ids=lambda told: str(told)[-60:])
def test_what_has_another_form_is_named_and_not_counted(told: object) -> None:
    found = reports(told)
    assert len(found.refused) == 1 and found.navigation.goals == 0
    assert found.refused[0].startswith(
        "r1: its report of its navigation is malformed and is not counted: "
        f"{RECORD}: the outcome 'navigation' is not that of a robot's navigation: "
    )
    assert "\n" not in found.refused[0] and len(found.refused[0]) < 400


def test_numbers_texts_and_booleans_of_a_behaviour_are_its_own_outcome() -> None:
    own = {
        "tokens": {"taken": 3, "share": 0.5, "list": [1]}, "done": True, "note": "=1", "nothing": None,
    }  # fmt: skip
    told = reports(own=own)
    assert told.refused == ()
    kept = {"done": True, "note": "=1", "tokens.share": 0.5, "tokens.taken": 3}
    assert told.outcomes == {name: {"r1": value} for name, value in kept.items()}
    two: Outcomes = {"a": {"r1": 1, "r2": 2.0}, "b": {"r1": True, "r2": False}, "c": {"r1": "x"}}
    assert means(two) == {"a": 1.5, "b": 0.5}


OUT_OF_BOUNDS: dict[str, dict[str, Any]] = {
    "an outcome has 21 values; must have at most 20": {f"n{number}": 1 for number in range(21)},
    "an outcome has 1 values; must have at most 20, with names of at most 100": {"x" * 101: 1},
    "the outcome 'note' is not that of a behaviour: it is": {"note": "x" * 201},
    "the outcome 'count' is not that of a behaviour: it is": {"count": 1 << 60},
    "the outcome 'deep' is not that of a behaviour: [": {"deep": {"x": {"y": 1}}},
    "the outcome 'gap' is not that of a behaviour: JSON is malformed": {"gap": math.nan},
}


@pytest.mark.parametrize("why", OUT_OF_BOUNDS)
def test_an_outcome_out_of_bounds_is_named_and_not_counted(why: str) -> None:
    told = reports(own=OUT_OF_BOUNDS[why])
    (refused,) = told.refused
    assert (
        refused.startswith("r1: its report of its outcome is malformed and is not counted: ")
        and why in refused
    )
    assert told.outcomes == {} and told.navigation.goals == 3
