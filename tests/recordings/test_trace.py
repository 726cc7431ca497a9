"""The trace of a robot: what it knew, change by change, what each came of; and how it is kept."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from acrc_testbed.replay.sandboxed import Call, ask
from acrc_testbed.run_model.recorded import messages_on
from acrc_testbed.trace import traces as keeping
from acrc_testbed.trace import traces as tracing
from acrc_testbed.trace.knowledge import ABSENT, KnownPoints, PathDifference, differences, root
from acrc_testbed.trace.program import whole
from acrc_testbed.trace.rows import Trace
from acrc_testbed.trace.traces import PART, Traced, traces
from actors.geometry import Point
from actors.messages import RECEIVED, Heard
from actors.robot.behaviour.foreign import INSTALLED, Permit


@pytest.fixture(scope="module")
def trace(recorded_run: Path) -> Trace:
    (found,) = whole(recorded_run, "r2")
    assert found.fault is None
    return found


def test_changes_lead_from_what_it_began_with_to_what_it_knew_last(trace: Trace) -> None:
    last: dict[str, str] = {}
    assert trace.has_nodes and len(trace.changes) > 100
    for change in trace.changes:
        assert change.changed and set(change.fields) == {root(one.path) for one in change.changed}
        assert change.step == change.instant // 100_000
        assert (change.read is None) is (change.peer == "") is change.by.startswith("AdaptiveCleaningRobot.")
        for field, one in change.fields.items():
            assert last.get(field, one.before) == one.before != one.after or one.direction or one.is_place
            last[field] = one.after


def test_an_adoption_names_its_replica_and_frame(recorded_run: Path, trace: Trace) -> None:
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
        if isinstance(event, Heard)
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


def test_a_point_is_found_wherever_it_came_into_knowledge_and_where_it_went() -> None:
    points, here = KnownPoints(), Point(1.0, 2.0)
    points.note(0, 5, "bids", {}, {"r2": Bid(here)})
    points.note(1, 6, "way", (), ((1.0, 2.0), (3.0, 4.0)))
    points.note(2, 7, "way", ((1.0, 2.0), (3.0, 4.0)), ((3.0, 4.0),))
    points.note(3, 7, "bids", {"r2": Bid(here)}, {"r2": Bid(here), "r3": Bid(Point(0.0, 0.0))})
    assert points.behind(here, 7, gone=False, again=False) == (1, 0)
    assert points.behind(here, 7, gone=False, again=True) == (3, 1)
    assert points.behind(here, 8, gone=False, again=True) == (1, 0)
    assert points.behind(here, 7, gone=True, again=False) == (2,)
    assert points.behind(None, 7, gone=True, again=False) == ()


class Counting:
    def __init__(self, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._out, self.replayed = out, list[str]()

        def counted(out: Path, module: str, calls: Sequence[Call], *words: Any, **more: Any) -> Any:
            self.replayed += [one.name for one in calls]
            return ask(out, module, calls, *words, **more)

        monkeypatch.setattr(tracing, "ask", counted)

    def of(self, actor: str, permit: Permit = INSTALLED) -> Traced:
        (found,) = traces(self._out, [actor], permit=permit, isolate=False)
        return found


@pytest.fixture
def counting(recorded_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Counting:
    copytree(recorded_run, tmp_path / "run")
    for path in (tmp_path / "run").glob("*/*.trace"):
        path.unlink()
    return Counting(tmp_path / "run", monkeypatch)


def test_a_robot_is_replayed(counting: Counting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = counting.of("r2").whole()
    assert counting.of("r2").whole().changes == first.changes and counting.replayed == ["r2"]
    assert counting.of("r2", Permit(trust=True)).parts and counting.replayed == ["r2", "r2"]
    recording = tmp_path / "run" / "r2" / "r2.mcap"
    file = recording.with_suffix(".trace")
    kept = file.read_bytes()
    for damaged in (kept[:-10], kept[:32] + b"\x01", b"", bytes([kept[0] ^ 1]) + kept[1:], kept + b"\x01"):
        file.write_bytes(damaged)
        assert keeping.kept(recording) is None
    counting.of("r2")
    assert counting.of("world") == Traced("world", fault="world: is no robot")
    assert counting.replayed == [*["r2"] * 3, "world"] and file.read_bytes() == kept
    with monkeypatch.context() as patch:
        patch.setattr(keeping, "VERSION", 0)
        assert keeping.kept(recording) is None
    came_of = keeping.inputs(recording)
    recording.write_bytes(recording.read_bytes()[:-1])
    assert keeping.kept(recording) is None, "of another recording"
    file.unlink()
    keeping.keep(recording, came_of, [b"of another one"])
    assert not file.exists()


def test_a_trace_is_bounded(counting: Counting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = tmp_path / "run" / "r2" / "r2.mcap"
    monkeypatch.setattr(keeping, "MOST_BYTES", 1_000_000)
    bomb = zlib.compress(bytes(2_000_000))
    came_of = keeping.inputs(recording)
    assert came_of is not None
    recording.with_suffix(".trace").write_bytes(came_of + PART.pack(len(bomb)) + bomb)
    assert keeping.kept(recording) is None
    with (recording.parent / "map.png").open("wb") as file:
        file.truncate(1 << 34)
    assert keeping.inputs(recording) is None
