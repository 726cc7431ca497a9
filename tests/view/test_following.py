"""A run that goes on is drawn as it grows, and in the end there is what is drawn of the finished one."""

import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from actors.observer.sheet import Sheet
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.recording import Entry, read_recording
from observation.evidence.run_reader import RunReader
from observation.recordings.topics import Standing, standing
from observation.replay.growing_replay import GrowingBus, GrowingReplay
from observation.replay.record_replay import made_again
from observation.trace.frame_fates import frame_fates, replayed
from observation.trace.kept import own_files
from observation.trace.rows import Trace
from observation.trace.traces import Traced, traces
from observation.view import drawn, live
from observation.view.drawn import Wishes, draw, read_story
from observation.view.live import Following
from observation.view.seen import Seen
from observation.view.story import Teller, Track, simulated_story

MORE = {f"/{what}{robot}" for what in ("plots/places/", "world/heading/", "") for robot in ("r1", "r2")}
"""Where a piece ends or begins something may be said once more, or what was short cannot be left out."""
LESS = {"/plots/ages/r1_at_r2", "/plots/ages/r2_at_r1"}
"""They end with what was computed, and not with the run."""


class Growing:
    """A copy of a run's folder that has its recordings up to a share of their bytes."""

    def __init__(self, whole: Path, out: Path) -> None:
        self._whole, self.out = whole, out
        shutil.copytree(whole, out, ignore=shutil.ignore_patterns("*.mcap", "*.trace", "run.json"))

    def grow(self, share: float) -> None:
        for path in self._whole.glob("*/*.mcap"):
            data = path.read_bytes()
            (self.out / path.relative_to(self._whole)).write_bytes(data[: round(share * len(data))])


@pytest.fixture
def growing(folder: Path, tmp_path: Path) -> Growing:
    return Growing(folder, tmp_path / "growing")


def drawn_at(path: Path) -> dict[str, set[Any]]:
    """By entity the instants at which something was drawn."""
    found: dict[str, set[Any]] = {}
    for chunk in RrdReader(str(path)).stream():
        rows = chunk.to_record_batch().to_pylist()
        found.setdefault(str(chunk.entity_path), set()).update(row.get("sim_time") for row in rows)
    return found


def test_a_run_that_grows_is_drawn_like_one_that_has_ended(
    growing: Growing, folder: Path, insides: dict[str, Trace], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    traced = [Traced(actor, (inside,)) for actor, inside in insides.items()]
    monkeypatch.setattr(drawn, "traces", lambda *words, **more: iter(traced))
    monkeypatch.setattr(drawn, "deadlocks", lambda story: {})  # which is known once a run has ended
    draw(read_story(folder), tmp_path / "whole.rrd", Wishes(), send_to=None, say=lambda sentence: None)
    growing.grow(0.31)
    with (
        Following(growing.out, (), permit=INSTALLED, isolate=False) as following,
        Sheet(tmp_path / "grown.rrd", following.arrangement, name="it goes on") as sheet,
    ):
        following.begin(sheet)
        following.draw()
        assert 5.0 < following.end < 12.0
        lacking = {what for what, _ in following.lack().computed}
        perceived = {f"what {robot} perceived and meant" for robot in ("r1", "r2")}
        assert lacking <= {"what became of frames", *perceived}  # what of it depends on who got a processor
        growing.grow(0.74)
        time.sleep(1.2)  # robots' words of a step are waited for so long where they are cut off
        following.draw()
        growing.grow(1.0)
        deadline = time.monotonic() + 60.0
        while not following.complete or following.end < 30.0:
            following.draw(last=following.run.behind == 0 and following.end > 29.85)
            assert time.monotonic() < deadline, list(following.lack().sentences(following.end))
            time.sleep(0.05)
        following.finish()
        assert list(following.lack().sentences(following.end)) == []
        kept = [growing.out / name / f"{name}.mcap" for name in ("r1", "r2", "radio")]
        while not all(path.with_suffix(".trace").exists() for path in kept):
            following.draw()
            assert time.monotonic() < deadline
            time.sleep(0.05)
    for actor, inside in insides.items():  # who looks at the run afterwards need not replay it
        (one,) = traces(growing.out, [actor], permit=INSTALLED, isolate=False)
        assert len(one.parts) > 1 and one.whole().changes == inside.changes
    assert frame_fates(growing.out) == replayed(folder)
    grown, whole = drawn_at(tmp_path / "grown.rrd"), drawn_at(tmp_path / "whole.rrd")
    assert set(grown) - {"/events/run/view"} == set(whole)
    for entity, instants in whole.items():
        if entity in LESS:
            assert grown[entity] >= set(sorted(instants - {None})[:-2]), entity
        elif entity in MORE:
            assert grown[entity] >= instants, entity
        else:
            assert grown[entity] == instants, entity


def test_pieces_of_a_run_come_to_the_whole(growing: Growing, folder: Path) -> None:
    whole, teller = simulated_story(folder), Teller()
    growing.grow(0.3)
    pieces = []
    with RunReader(growing.out) as run:
        for share in (0.3, 0.55, 0.8, 1.0):
            growing.grow(share)
            pieces.append(run.poll(last=share == 1.0))
        assert run.poll(last=True) is None
    told = [teller.story(piece) for piece in pieces if piece is not None]
    assert len(told) == 4
    for name in ("routes", "reported", "taken_over", "given_up"):
        assert sum((getattr(piece, name) for piece in told), ()) == getattr(whole, name)
    for robot, track in whole.tracks.items():
        for name in ("seconds", "poses", "held"):
            parts = [getattr(piece.tracks[robot], name) for piece in told]
            np.testing.assert_array_equal(np.concatenate(parts), getattr(track, name))
    heard = np.concatenate([piece.heard for piece in told])
    assert sorted(map(tuple, heard.tolist())) == sorted(map(tuple, whole.heard.tolist()))
    assert told[-1].places == whole.places and told[-1].end == whole.end == 30.0


def test_whether_a_run_goes_on_is_told_from_who_writes(growing: Growing, folder: Path) -> None:
    assert standing(folder) is Standing.ENDED
    growing.grow(0.5)
    assert standing(growing.out) is Standing.DIED
    with (growing.out / "world" / "world.mcap").open("ab") as file:
        writer = subprocess.Popen(["sleep", "60"], stdout=file)
    assert standing(growing.out) is Standing.GOING_ON
    writer.kill()
    writer.wait()
    assert standing(growing.out) is Standing.DIED
    growing.grow(1.0)
    assert standing(growing.out) is Standing.ENDED


def test_an_actor_that_does_otherwise_is_found_out_also_before_it_was_recorded(growing: Growing) -> None:
    growing.grow(0.05)
    bus = GrowingBus(made_again(growing.out, "r1"))
    bus.publish("swarm/up/r1/drive", b"before it is ready")
    growing.grow(0.2)
    with pytest.raises(
        ReplayError, match="sends on swarm/up/r1/drive; recorded was a message on swarm/up/r1/ready"
    ):
        bus.grow()
    bus.close()


def test_a_closed_recording_is_held_to_its_last_message(folder: Path) -> None:
    with GrowingReplay(made_again(folder, "r1")) as replay:
        while not replay.ended:
            replay.advance(1.0)
        replay.settle()
        replay._bus._early.append(("swarm/up/r1/drive", b"one more"))
        with pytest.raises(ReplayError, match="sends on swarm/up/r1/drive, where nothing more was recorded"):
            replay.settle()
        replay._bus._early.clear()
        sent = next(one for one in read_recording(replay.path) if isinstance(one, Entry))
        replay._bus._outputs.append(sent)
        with pytest.raises(ReplayError, match="does not send again what was recorded on"):
            replay.settle()


def test_who_follows_a_robot_reads_neither_its_password_nor_its_socket(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "r1", tmp_path / "r1")
    for name in ("credentials", "router.sock"):
        (tmp_path / "r1" / name).write_text("a secret")
    shown = {path.name for path in own_files(tmp_path / "r1" / "r1.mcap")}
    assert {"r1.mcap", "map.yaml", "map.png"} <= shown
    assert not {"credentials", "router.sock", "r1.log"} & shown


def test_who_hangs_is_not_waited_for(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    class Hung:
        complete, drawn = False, 0

        def draw(self, *, last: bool = False) -> bool:
            self.drawn += 1
            return False

        def flush(self) -> None:
            pass

        def finish(self) -> None:
            self.finished = True

    hung: Any = Hung()
    for name in ("_SETTLING_S", "_STUCK_S"):
        monkeypatch.setattr(live, name, 0.2)
    began = time.monotonic()
    live._draw_all(folder, hung, hung, None, lambda sentence: None)
    assert hung.drawn > 2 and hung.finished and time.monotonic() - began > 0.2


def test_who_is_off_seems_to_be_about_nothing_and_who_stays_for_3_s_to_stand() -> None:
    seconds = np.arange(12, dtype=np.float64)
    along = np.array([0, 1, 2, 2, 2, 3, 4.0, 4.05, 4.0, 4.0, 4.0, 5.0])
    poses = np.column_stack((along, np.zeros(12), np.zeros(12)))
    seen = Seen("r1")
    first = Track(seconds[:4], poses[:4], poses[:4], ((0.0, ""), (3.0, "off")))
    assert [(one.second, one.activity) for one in seen.of(first, ())] == [(0.0, "driving")]
    later = Track(seconds[4:], poses[4:], poses[4:], ((5.0, ""),))
    assert [(one.second, one.activity) for one in seen.of(later, ())] == [
        (5.0, "driving"), (6.0, "standing"), (11.0, "driving"),
    ]  # fmt: skip
