"""Explanations of decisions with known causes: planted ones, and some of the chapter's rules."""

import json
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from acrc_testbed.explanation.chain import CauseLink
from acrc_testbed.explanation.explainer import (
    Explainer,
    Explanation,
    ExplanationError,
    parse_request,
    sentences,
)
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.code_permit import Permit
from tests.in_process import acrc
from tests.recorded_runs import record

SCENARIO = """
map = "../maps/corridor.yaml"

[run]
duration = 16.0
seed = 1
strategy = "tests.explanation.planted:behaviour"

[deeco]
relay = true

[robots]
count = 4
start = [[6.5, 12.5, 0.0], [13.0, 12.5, 0.0], [20.0, 12.5, 0.0], [12.0, 11.5, 0.0]]

[localisation]
preset = "odometry"

[navigation]
preset = "robust"

[places]
preset = "golden"
per_robot = 1

[[event]]
at = 4.9
jam = [13.0, 12.5]
radius = 3.0
duration = 3.0
"""
"""r2 and r4 are jammed from 4.9 s to 7.9 s; r3 is out of range of r1."""


@pytest.fixture(scope="session")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("planted") / "out"
    record(out, SCENARIO)
    return out


@pytest.fixture(scope="session")
def doorway(complete_run: Path) -> Path:
    return complete_run


class Known(NamedTuple):
    """A decision and links of its chain: kind, instant, part of the sentence."""

    run: str
    who: str
    words: str
    chain: tuple[tuple[str, float, str], ...]


PLANTED = (
    Known("planted", "r1@2", "drives to (5.00, 12.50)", (
        ("process", 2.0, "going - → 5.00, 12.50, by process tests.explanation.planted.Planted.go"),
        ("state", 2.0, "wish - → 5.00, 12.50, by Planted.want"),
        ("state", 2.0, "number 0 → 3 since 0 s, by Planted.count"))),
    Known("planted", "r1@7", "pauses", (
        ("process", 7.0, "standing False → True, by process tests.explanation.planted.Planted.halt"),
        ("state", 7.0, "number 0 → 8 since 0 s, by Planted.count"))),
    Known("planted", "r1@8", "backs out 0.5 m along its trail", (
        ("goal", 8.0, "paused"),
        ("process", 8.0, "by process tests.explanation.planted.Planted.retreat"),
        ("state", 8.0, "number 0 → 9 since 0 s, by Planted.count"))),
    Known("planted", "r1@9", "relocalises", (
        ("process", 9.0, "by process tests.explanation.planted.Planted.doubt"),
        ("state", 9.0, "number 0 → 10 since 0 s, by Planted.count"))),
    Known("planted", "r1@10", "gives up r1/0: eleven", (
        ("process", 10.0, "place left False → True, by process tests.explanation.planted.Planted.leave"),
        ("state", 10.0, "number 0 → 11 since 0 s, by Planted.count"))),
    Known("planted", "r1@11", "stops", (
        ("process", 11.0, "going 4.00, 12.00 → -, by process tests.explanation.planted.Planted.rest"),
        ("state", 11.0, "number 0 → 12 since 0 s, by Planted.count"))),
    Known("planted", "r2@3.5", "drives to (5.00, 12.50)", (
        ("state", 3.0, "wish - → 5.00, 12.50, by Following.at_member with r1"),
        ("replica", 2.701, "replica of r1, 0.299 s old (publication 3): wish 5.00, 12.50"),
        ("frame", 2.701, "received in a frame of r1, direct"),
        ("lost", 2.701, "no frame of r1 was lost between 1.7 and 2.701 s"))),
    Known("planted", "r2@9.5", "drives to (4.00, 12.00)", (
        ("state", 9.0, "wish 5.00, 12.50 → 4.00, 12.00, by Following.at_member with r1"),
        ("frame", 8.702, "received in a frame of r1, direct"),
        ("lost", 7.701, "3 frames of r1 were lost between 4.702 and 8.702 s: 5.701 s disturbed"))),
    Known("planted", "r3@5.5", "drives to (5.00, 12.50)", (
        ("state", 5.0, "by Following.at_member with r1"),
        ("frame", 4.866, "relayed once"))),
    Known("planted", "r3@9.5", "drives to (4.00, 12.00)", (
        ("state", 9.0, "by Following.at_member with r1"),
        ("frame", 8.872, "received in a frame of r4, relayed once"),
        ("lost", 8.78, "below sensitivity"))),
)  # fmt: skip
"""r1 decides by its count; r2 receives r1, r3 a relay; r4 follows r2; r2 and r4 are jammed at times."""
DOORWAY = (
    Known("doorway", "r2@12", "drives again to (12.52, 4.68)", (
        ("goal", 12.0, "navigation had aborted the goal (12.52, 4.68): blocked"),)),
    Known("doorway", "r2@15", "takes over r1/0", (
        ("exchange", 15.0, "by exchange cleaning.adoption.DestinationAdoption.at_member with r1"),
        ("replica", 14.702, "state blocked"),
        ("frame", 14.702, "received in a frame of r1, direct"),
        ("state", 15.0, "blocked for 0 → 1, by AdaptiveCleaningRobot.auto_unblock"),
        ("state", 15.0, "state free → blocked, by AdaptiveCleaningRobot.detect_blocked"))),
    Known("doorway", "r2@16", "drives to (9.00, 12.50)", (
        ("process", 16.0, "by process cleaning.robot.CleaningRobot.drive"),
        ("state", 15.0, "destination r2/0 → r1/0"),
        ("replica", 14.702, "replica of r1"))),
    Known("doorway", "r1@18", "takes over r2/0, hands over r1/0", (
        ("exchange", 18.0, "by exchange cleaning.adoption.AdoptedDestinationRemove.at_member with r2"),
        ("replica", 17.445, "adopted r1/0, destination r1/0, former r2/0"))),
    Known("doorway", "r2@57", "takes over r1/1", (
        ("exchange", 57.0, "by exchange cleaning.adoption.DestinationAdoption.at_member with r1"),
        ("replica", 56.701, "state blocked"),
        ("state", 57.0, "blocked for 0 → 3 since 55 s"),
        ("state", 55.0, "state free → blocked"))),
)  # fmt: skip


GROUPED = (
    Known("grouped", "r1@3.5", "drives to (13.00, 11.80)", (
        ("state", 3.0, "wish - → 13.00, 11.80, by Meeting.at_group with r2"),
        ("frame", 2.446, "received in a frame of r2, direct"),
        ("state", 3.0, "by Meeting.offer with r2"))),
    Known("grouped", "r2@4.5", "drives to (13.00, 11.80)", (
        ("state", 4.0, "wish - → 13.00, 11.80, by Meeting.at_member with r1"),
        ("replica", 3.709, "meeting 13.00, 11.80"),
        ("state", 4.0, "by Meeting.confirm with r1"))),
)  # fmt: skip
"""r1 sets its wish when two guests have confirmed; they receive it from r1."""


@cache
def explainer(out: Path, robot: str) -> Explainer:
    return Explainer(out, robot, permit=Permit((REPOSITORY,)), isolate=False)


def answered(out: Path, one: Known) -> Explanation:
    asked = parse_request(one.who)
    assert asked.at_s is not None
    found = explainer(out, asked.robot).explain(asked.at_s)
    return next(answer for answer in found if answer.decision == one.words)


def stands(chain: tuple[CauseLink, ...], cause: tuple[str, float, str]) -> bool:
    kind, at_s, words = cause
    return any(
        link.kind == kind and link.at_s == pytest.approx(at_s, abs=0.002) and words in link.says
        for link in chain
    )


def check(out: Path, knowns: tuple[Known, ...]) -> None:
    wrong = {}
    for one in knowns:
        answer = answered(out, one)
        missing = [cause for cause in one.chain if not stands(answer.chain, cause)]
        if missing or not answer.exact:
            wrong[one.who] = (missing, list(sentences(answer)))
    assert wrong == {}


def test_planted_causes_are_named_whatever_the_strategy(planted: Path) -> None:
    check(planted, PLANTED)


def test_causes_in_a_group_are_named(tmp_path: Path) -> None:
    record(tmp_path / "out", SCENARIO.replace("planted:behaviour", "grouped:behaviour"), duration=5.0)
    check(tmp_path / "out", GROUPED)


def test_causes_of_the_chapters_decisions_are_named(doorway: Path) -> None:
    check(doorway, DOORWAY)


def test_causes_stand_below_their_effects(doorway: Path) -> None:
    (answer,) = explainer(doorway, "r2").explain(15.0)
    assert answer.chain[0].depth == 0
    for link, below in zip(answer.chain, answer.chain[1:], strict=False):
        assert 1 <= below.depth <= link.depth + 1 and below.at_s <= answer.at_s
    frame = next(link for link in answer.chain if link.kind == "frame").about
    assert frame["sender"] == "r1" and frame["hops"] == 0 and -95 < frame["rssi_dbm"] < -60
    assert 0 < frame["airtime_ms"] < 5 and 14.69 < frame["handed_s"] < 14.702


def test_between_decisions_the_previous_one_is_explained(doorway: Path) -> None:
    (answer,) = explainer(doorway, "r2").explain(50.0)
    assert (answer.at_s, answer.exact) == (32.0, False)
    assert next(sentences(answer)) == "r2 made no decision at 50 s; its last one before that, at 32 s:"


def test_before_the_first_decision_its_instant_is_named(planted: Path) -> None:
    with pytest.raises(ExplanationError) as caught:
        explainer(planted, "r2").explain(1.0)
    assert str(caught.value) == "r2 made no decision before 1 s; its first decision is at 3.5 s"


def test_after_the_end_nothing_is_explained(doorway: Path) -> None:
    with pytest.raises(ExplanationError, match=r"^r2@5000: the robot's recording ends at \d+(\.\d)? s$"):
        explainer(doorway, "r2").explain(5000.0)


@pytest.mark.parametrize("text", ["r2@", "@3", "r2@soon", "r2@-1"])
def test_invalid_requests(text: str) -> None:
    with pytest.raises(ExplanationError) as caught:
        parse_request(text)
    assert (
        str(caught.value)
        == f"{text}: must be a robot, such as r2, or a robot and simulated seconds, such as r2@157"
    )


def test_the_command_prints_text_and_json(doorway: Path) -> None:
    told = acrc("explain", doorway, "r2@15")
    assert told.returncode == 0, told.stderr
    lines = told.stdout.splitlines()
    assert lines[0].startswith("   15.000 s  r2 takes over r1/0, by exchange cleaning.adoption.")
    (answer,) = json.loads(acrc("explain", doorway, "r2@15", "--json").stdout)
    assert answer["decision"] == "takes over r1/0" and len(answer["chain"]) == len(lines)
    rows = acrc("explain", doorway, "r2").stdout.splitlines()
    assert "   15.000 s  takes over r1/0  (DestinationAdoption.at_member)" in rows
    assert len(rows) == len(explainer(doorway, "r2").listed())
