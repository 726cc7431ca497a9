"""What a robot says of itself is marked, held to what others have counted, and named where it cannot be."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.runtime.message_counts import MessageHash
from actors.runtime.process import FinalNote
from deeco.replication.fragments import Fragmenter
from observation.results.outcome import Outcomes, means
from observation.results.robot_reports import OthersCounts, RobotReports, robot_reports
from tests.swarm.command import acrc

RECORD = Path("out/r1/r1.mcap")
SEEN = OthersCounts(steps=100, step_us=100_000, frames={"r1": {"frames_sent": 20, "copies_heard": 30}})
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
    return robot_reports([("r1", RECORD, final)], SEEN)


def test_as_many_packets_can_have_come_as_fit_into_the_frames() -> None:
    packets = [b"x"] * 8
    frames = Fragmenter(1).frames(packets)
    assert len(frames) == 1 and len(Fragmenter(1).frames([*packets, b"x"])) == 2
    told = reports(node=NODE | {"counters": {"packets": 240}})
    assert told.refused == ()
    assert told.deeco.counters["packets"] == 240


def test_what_can_be_is_counted() -> None:
    told = reports(unread=5)
    assert told.refused == ()
    assert (told.navigation.goals, told.deeco.counters["packets"], told.unread) == (3, 30, 5)


NAVIGATION_LIES = {
    "goals": (12346, "12346 goals given and 1 taken back in 100 steps"),
    "succeeded": (3, "4 goals reached or given up, of 3"),
    "recoveries": (2001, "2001 recoveries in 100 steps"),
    "retreats": (10**9, "1000000000 retreats in 100 steps"),
    "given_unlisted": (3, "4 goals listed, of 3"),
    "aborted": ({"the weather": 1}, "goals given up for 'the weather', which is no reason"),
    "no_valid_trajectory": (
        [[0, 10_000_001, "run"]], "something from 0 to 10000001 µs, in a run of 10000000 µs",
    ),
    "paused": ([[10_000_001, None]], "something from 10000001 to 10000001 µs, in a run of 10000000 µs"),
    "without_plan": ([[2, 1]], "something from 2 to 1 µs, in a run of 10000000 µs"),
}  # fmt: skip


@pytest.mark.parametrize("name", NAVIGATION_LIES)
def test_navigation_that_cannot_have_been_is_named_and_not_counted(name: str) -> None:
    lie, why = NAVIGATION_LIES[name]
    told = reports(NAVIGATION | {name: lie})
    assert told.refused == (f"r1: what it says of its navigation cannot be, and is not counted: {why}",)
    assert told.navigation.goals == 0 and told.deeco.counters["packets"] == 30


NODE_LIES = {
    "more frames than the radio took": (
        {"counters": {"frames_sent": 21}}, "21 frames sent; the radio counted 20 frames",
    ),
    "more packets than came": (
        {"counters": {"packets": 241}}, "241 packets heard; the radio counted 30 frames",
    ),
    "too much": ({"exchanges": {"Adoption": 10**9}}, "1000000000 Adoption in 100 steps"),
    "too many samples": (
        {"replica_age_ms": {"50": 10**12}}, "1000000000000 samples of replicas' age in 100 steps",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", NODE_LIES)
def test_a_node_that_cannot_have_been_is_named_and_not_counted(name: str) -> None:
    lie, why = NODE_LIES[name]
    told = reports(node=NODE | lie)
    assert told.refused == (f"r1: what it says of its node cannot be, and is not counted: {why}",)
    assert told.deeco.counters == {} and told.navigation.goals == 3


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
        "r1: what it says of its navigation cannot be, and is not counted: "
        f"{RECORD}: the outcome 'navigation' is not that of a robot's navigation: "
    )
    assert "\n" not in found.refused[0] and len(found.refused[0]) < 400


def test_messages_that_never_came_cannot_be_unread() -> None:
    told = reports(unread=6)
    assert told.unread == 0
    assert told.refused == ("r1: what it says of its messages cannot be, and is not counted: 6 unread of 5",)


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
        refused.startswith("r1: what it says of its outcome cannot be, and is not counted: ")
        and why in refused
    )
    assert told.outcomes == {} and told.navigation.goals == 3


def test_robots_that_lie_of_themselves_are_named_by_the_run(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("scenarios/head_on.toml", "--duration", 4, "--strategy", "tests.results.liar:behaviour")
    done = acrc("run", *words, "--out", out)
    assert done.returncode == 0, done.stderr
    result = json.loads((out / "run.json").read_text())
    sent = result["frames_by_robot"]["r2"]["frames_sent"]
    lies = [
        "r1: what it says of its navigation cannot be, and is not counted: "
        "12346 goals given and 0 taken back in 40 steps",
        "r2: what it says of its node cannot be, and is not counted: "
        f"1000 frames sent; the radio counted {sent} frames",
    ]
    assert result["refused_reports"] == lies
    assert [line for line in done.stdout.splitlines() if "cannot be" in line] == lies
    assert result["reported_by_robots"] == ["deeco", "navigation", "outcome", "unread"]
    assert result["navigation"]["goals"] == 1, "the honest one's"
    assert result["deeco"]["counters"]["frames_sent"] == result["frames_by_robot"]["r1"]["frames_sent"]
    assert 0 < result["cpu_s"] < 100, "charged by the system, whatever r2 says"
    assert (
        json.loads(acrc("run", *words[:3], "--out", tmp_path / "honest", "--json").stdout)["refused_reports"]
        == []
    )
