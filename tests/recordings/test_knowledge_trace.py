"""What a robot knew, change by change, and what each change came of."""

from pathlib import Path

import pytest

from actors.messages import RECEIVED, Heard
from actors.runtime.recording import RecordingError
from observation.evidence.knowledge_trace import ABSENT, Changed, KnowledgeTrace, differences, trace_knowledge
from observation.evidence.recorded import taken


@pytest.fixture(scope="module")
def trace(met: Path) -> KnowledgeTrace:
    return trace_knowledge(met, "r2")


def test_changes_lead_from_what_it_began_with_to_what_it_knew_last(trace: KnowledgeTrace) -> None:
    assert trace.report is not None and trace.report.whole and trace.report.outputs > 200
    (beginning,) = trace.beginnings
    before = beginning.knowledge
    for change in trace.changes:
        assert change.changed and list(change.changed) == list(differences(before, change.after))
        assert change.step == change.instant // 100_000
        before = change.after


def test_an_adoption_names_the_replica_and_the_frame_that_brought_it(
    met: Path, trace: KnowledgeTrace
) -> None:
    adoption = next(one for one in trace.changes if one.by == "DestinationAdoption.at_member")
    read = adoption.read
    assert adoption.adaptation and adoption.peer == "r1" and read is not None and read.arrival is not None
    assert read.heard + read.age == adoption.instant == 15_000_000
    assert (read.component, read.epoch, read.hops) == ("r1", 0, 0) and read.publication > 10
    assert "destination.owner" in {one.path for one in adoption.changed}
    frames = {
        (received.step, event.instant, event.sender, event.rssi_dbm, event.lqi)
        for _, received in taken(met / "r2" / "r2.mcap", RECEIVED)
        for event in received.events
        if isinstance(event, Heard)
    }
    assert tuple(read.arrival) in frames
    assert any(one.replica.roles == read.roles for one in trace.heard)


def test_processes_use_no_replica_and_no_peer(trace: KnowledgeTrace) -> None:
    for change in trace.changes:
        assert (change.read is None) is (change.peer == "") is change.by.startswith("AdaptiveCleaningRobot.")


def test_it_ends_where_nothing_more_is_asked_for(met: Path, trace: KnowledgeTrace) -> None:
    part = trace_knowledge(met, "r2", until_s=5.0)
    assert part.report is not None and not part.report.whole
    assert part.changes == [one for one in trace.changes if one.step <= 50]


def test_who_has_no_recording_is_told(met: Path) -> None:
    with pytest.raises(RecordingError, match="no recording of 'r9'; there are r1, r2, radio, world"):
        trace_knowledge(met, "r9")


def test_differences_are_as_deep_as_both_sides_go() -> None:
    before, after = {"a": (1, 2), "b": {"c": 3}}, {"a": (1, 3), "b": {}, "d": 4}
    assert list(differences(before, after)) == [
        Changed("[a]", (1, 2), (1, 3)), Changed("[b][c]", 3, ABSENT), Changed("[d]", ABSENT, 4),
    ]  # fmt: skip
