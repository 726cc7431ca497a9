"""Causal traces: changes of knowledge and their sources."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from acrc_testbed.explanation.causal_trace import CausalTrace
from acrc_testbed.explanation.trace_replay import trace_here
from acrc_testbed.explanation.tracer import KnownPoints, field_of
from acrc_testbed.recordings.record_replay import ReplayOptions
from acrc_testbed.run_model.recording_readers import messages_on
from actors.geometry import Point
from actors.messages import RECEIVED, FrameReceived
from actors.robot.introspector import ABSENT, PathDifference, differences


@pytest.fixture(scope="module")
def trace(recorded_run: Path) -> CausalTrace:
    found = trace_here(recorded_run, "r2", ReplayOptions())
    assert found.fault is None
    return found


def test_changes_lead_from_the_initial_to_the_final_knowledge(trace: CausalTrace) -> None:
    last: dict[str, str] = {}
    assert trace.has_nodes and len(trace.changes) > 100
    for change in trace.changes:
        assert change.changed and set(change.fields) == {field_of(one.path) for one in change.changed}
        assert change.step == change.instant // 100_000
        assert (change.read is None) is (change.peer == "") is change.by.startswith("AdaptiveCleaningRobot.")
        for field, one in change.fields.items():
            assert last.get(field, one.before) == one.before != one.after or one.direction or one.is_point
            last[field] = one.after


def test_an_adoption_names_its_replica_and_frame(recorded_run: Path, trace: CausalTrace) -> None:
    adoption = next(one for one in trace.changes if one.by == "DestinationAdoption.at_member")
    read = adoption.read
    assert adoption.adaptation and adoption.peer == "r1" and read is not None and read.arrival is not None
    assert read.heard + read.age == adoption.instant == 15_000_000 and read.age == adoption.age
    assert (read.component, read.epoch, read.hops) == ("r1", 0, 0) and read.publication > 10
    assert "destination.owner" in {one.path for one in adoption.changed}
    assert adoption.decision is not None and adoption.decision.words == "takes over r1/0"
    frames = {
        (received.step, event.instant, event.sender, event.rssi_dbm, event.lqi)
        for _, received in messages_on(recorded_run / "r2" / "r2.mcap", RECEIVED)
        for event in received.events
        if isinstance(event, FrameReceived)
    }
    arrival = read.arrival
    assert (arrival.step, arrival.instant, arrival.sender, arrival.rssi_dbm, arrival.lqi) in frames
    assert ("r1", read.heard) in {(one.peer, one.heard) for one in trace.news}


def test_differences_are_as_deep_as_both_sides_go() -> None:
    before, after = {"a": (1, 2), "b": {"c": 3}}, {"a": (1, 3), "b": {}, "d": 4}
    assert list(differences(before, after)) == [
        PathDifference("[a]", (1, 2), (1, 3)),
        PathDifference("[b][c]", 3, ABSENT),
        PathDifference("[d]", ABSENT, 4),
    ]


@dataclass(frozen=True)
class Bid:
    at: Point


def test_changes_that_set_or_removed_a_point_are_found() -> None:
    points, here = KnownPoints(), Point(1.0, 2.0)
    points.add_change(0, 5, "bids", {}, {"r2": Bid(here)})
    points.add_change(1, 6, "way", (), ((1.0, 2.0), (3.0, 4.0)))
    points.add_change(2, 7, "way", ((1.0, 2.0), (3.0, 4.0)), ((3.0, 4.0),))
    points.add_change(3, 7, "bids", {"r2": Bid(here)}, {"r2": Bid(here), "r3": Bid(Point(0.0, 0.0))})
    assert points.changes_of(here, 7, removed=False, retained=False) == (1, 0)
    assert points.changes_of(here, 7, removed=False, retained=True) == (3, 1)
    assert points.changes_of(here, 8, removed=False, retained=True) == (1, 0)
    assert points.changes_of(here, 7, removed=True, retained=False) == (2,)
    assert points.changes_of(None, 7, removed=True, retained=False) == ()
