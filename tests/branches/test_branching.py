"""A run continued from an instant: the same without a change, and otherwise only from the change on."""

import json
from pathlib import Path

import pytest

from actors.messages import TRANSMIT, Transmit
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.recording import Entry, read_recording
from deploy.branches.branching import BranchError
from deploy.branches.change import Change, event
from deploy.replay.run_recordings import recordings
from deploy.replay.swarm_replay import replay_swarm
from tests.branches.conftest import Leave

STEP_S = 0.1


def _digest(out: Path) -> str:
    return str(json.loads((out / "run.json").read_text())["digest"])


@pytest.mark.parametrize("at_s", [0.1, 7.3])
def test_nothing_changed_is_the_run_itself(origin: Path, leave: Leave, at_s: float) -> None:
    same = leave(Change(at_s))
    assert (same.result.digest, same.divergence) == (_digest(origin), None)


def test_another_strategy_begins_at_its_instant_and_can_be_replayed(leave: Leave, origin: Path) -> None:
    other = leave(Change(8.0, "none"))
    assert other.divergence is not None
    assert other.divergence.step >= 80
    told = other.result.origin.branch
    assert told is not None
    assert (told.run, told.digest, told.changes) == (
        str(origin),
        _digest(origin),
        ("strategy none from 8 s on",),
    )
    assert other.result.origin.strategy == "chapter>none@8.0"
    assert replay_swarm(Path(other.result.out), trust=False).digest == other.result.digest


def test_an_event_is_an_order_that_is_recorded_and_can_be_replayed(leave: Leave) -> None:
    ended = leave(Change(4.0, events=(event("kill r2 at 6", 4.0),)))
    assert ended.divergence is not None
    assert (
        ended.divergence.words
        == "step 60: swarm/down/r2/senses: Senses.halt is True; in the run it was False"
    )
    assert ended.divergence.robots["r2"] == 6.0
    assert replay_swarm(Path(ended.result.out), trust=False).orders == 1


def test_one_frame_that_nobody_hears_is_named_with_who_missed_it(origin: Path, leave: Leave) -> None:
    step, sender, receiver = _lone_frame(origin)
    jammed = leave(Change(1.0, events=(event(f"jam 0 0 1000 0.1 at {step * STEP_S:.1f}", 1.0),)))
    parted = jammed.divergence
    assert parted is not None
    assert (parted.step, parted.key) == (step + 1, f"swarm/down/{receiver}/received")
    assert parted.words.startswith(
        f"step {step + 1}: swarm/down/{receiver}/received: only in the run: Received("
    )
    assert f"sender={sender[1:]}" in parted.words


def test_an_instant_that_the_run_has_not_come_to(leave: Leave) -> None:
    with pytest.raises(BranchError, match="ends at 12 s; a branch must leave it before"):
        leave(Change(12.0))


def _lone_frame(origin: Path) -> tuple[int, str, str]:
    """A step in which one robot sends a single frame, alone: the step, who, and who hears it a step later."""
    sent: dict[int, list[str]] = {}
    heard: dict[int, list[str]] = {}
    for robot in ("r1", "r2"):
        for item in read_recording(recordings(origin)["radio"]):
            if isinstance(item, Entry) and item.key == TRANSMIT.key(robot) and item.payload is not None:
                told = decode(at(TRANSMIT, "*").topic, item.key, item.payload)
                assert isinstance(told, Transmit)
                sent.setdefault(told.step, []).extend([robot] * len(told.frames))
        for item in read_recording(recordings(origin)[robot]):
            if isinstance(item, Entry) and item.key.endswith("/received"):
                heard.setdefault(item.step, []).append(robot)
    lone = {step: who[0] for step, who in sent.items() if len(who) == 1 and step > 10}
    return next(
        (step, who, other)
        for step, who in sorted(lone.items())
        for other in [robot for robot in ("r1", "r2") if robot != who]
        if other in heard.get(step + 1, []) and step - 1 not in sent and step + 1 not in sent
    )
