"""Branches of a run: identical without a change, and different only from the change on."""

import json
import random
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import NamedTuple

import pytest

from acrc_testbed.run_model.frame_outcomes import frame_rows
from acrc_testbed.run_model.recording_readers import frame_outcomes
from acrc_testbed.run_model.simulated_runs import recorded_run
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.instant import in_seconds, milliseconds
from actors.messages import RECEIVED
from actors.orders import LoseFrame
from actors.robot.behaviour.code_permit import INSTALLED
from actors.runtime.errors import AcrcError
from deploy.run.branching import BranchResult, branch
from deploy.run.change import BranchEvent, Change, parse_event, strategy_settings
from deploy.run.options import RunOptions
from deploy.run.swarm_replay import SCENARIO, replay_swarm
from tests.in_process import acrc
from tests.recorded_runs import record

STEP_US = milliseconds(100)
Leave = Callable[[Change], BranchResult]


@pytest.fixture(scope="module")
def origin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots that meet, with the chapter's adaptation, for 12 s, in memory."""
    out = tmp_path_factory.mktemp("origin") / "run"
    record(out, duration=12.0)
    return out


@pytest.fixture
def leave(origin: Path, tmp_path: Path) -> Leave:
    """Return a function that carries out a branch."""
    number = count()

    def run_campaign(change: Change) -> BranchResult:
        out = tmp_path / f"branch-{next(number)}"
        return branch(origin, change, RunOptions(out, bus="memory"), permit=INSTALLED)

    return run_campaign


def _digest(out: Path) -> str:
    return str(json.loads((out / "run.json").read_text())["digest"])


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
    assert replay_swarm(Path(str(other.result.out)), permit=INSTALLED).digest == other.result.digest
    internals = recorded_run(Path(str(other.result.out)), internals=True).internals
    inside = next(one for one in internals if one.process.robot == "r1")
    known = [second for second, _ in inside.knowledge]
    assert min(known) < 8.0 < max(known), "of both strategies"
    assert {"state" in dict(rows) for second, rows in inside.knowledge if second < 8.0} == {True}
    assert inside.activities[0].destination == "r1/0"


def test_an_event_is_an_order_that_is_recorded_and_can_be_replayed(leave: Leave) -> None:
    ended = leave(Change(4.0, events=(parse_event("kill r2 at 6", 4.0),)))
    assert ended.divergence is not None
    assert (
        ended.divergence.words
        == "step 60: swarm/down/r2/senses: SensorData.halt is True; in the run it was False"
    )
    assert ended.divergence.robots["r2"] == 6.0
    assert replay_swarm(Path(str(ended.result.out)), permit=INSTALLED).orders == 1


def test_another_setting_of_the_same_strategy(leave: Leave) -> None:
    other = leave(Change(8.0, settings={"reach": 0.7}))
    assert other.divergence is not None and other.divergence.step >= 80
    assert other.result.origin.strategy == 'chapter>chapter{"reach":0.7}@8.0'
    told = other.result.origin.branch
    assert told is not None and told.changes == ("strategy.reach=0.7 from 8 s on",)
    control = other.control
    assert control is not None
    assert (told.control, told.control_difference) == (
        control.digest,
        "" if control.divergence is None else control.divergence.words,
    )
    assert control.digest == other.result.digest, "only the restart differs from the run"
    matters = leave(Change(8.0, settings={"reach": 6.0})).control
    assert matters is not None and matters.divergence is not None
    assert "in the control it was" in matters.divergence.words
    assert replay_swarm(Path(str(other.result.out)), permit=INSTALLED).digest == other.result.digest


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (Change(8.0, settings={"speed": 2}), r"unknown key strategy\.speed"),
        (Change(12.0), "ends at 12 s; branch before that"),
    ],
)
def test_impossible_changes(leave: Leave, change: Change, fault: str, tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match=fault):
        leave(change)
    assert not list(tmp_path.iterdir())


def test_events_that_do_not_happen_are_named(leave: Leave) -> None:
    words = ("kill r9 at 4.05", "lose r1 r1 at 5", "kill r1 at 12")
    done = leave(Change(4.0, events=tuple(parse_event(one, 4.0) for one in words)))
    assert done.failed_events == (
        "at 4.1 s: cannot kill 'r9': no such robot",
        "at 5 s: cannot lose a frame of r1 at itself: robot and sender must differ",
        "at 12 s: the branch ended at 12 s",
    )
    assert done.divergence is None


def test_the_command_prints_the_result(origin: Path, tmp_path: Path) -> None:
    done = acrc("branch", f"{origin}@11", "--event", "move r1 12.44 3.7 0", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert f"branch of {origin} at 11 s: move r1 12.44 3.7 0 at 11 s; replayed up to there in " in done.stderr
    assert "\nfirst difference: step 110: " in done.stderr
    assert "\nrobots that differ: r1 from 11 s" in done.stderr
    for words, sentence in (
        ((origin,), f"branch: {origin}; must be a run's folder and a time above 0 s"),
        ((f"{origin}@5", "--seed", 3), "--seed: unknown option of acrc branch"),
        ((f"{origin}@5", "--strategy", "x"), "--strategy: unknown strategy 'x'"),
    ):
        refused = acrc("branch", *words, "--out", tmp_path / "none")
        assert (refused.returncode, sentence in refused.stderr) == (2, True), refused.stderr


@pytest.mark.parametrize(
    ("key", "had", "other"),
    [
        ("deeco.publish", 1, 2.0),
        ("radio.preset", "chapter", "beeclick"),
        ("localisation.preset", "odometry", "chapter"),
        ("dwa.max_speed", 0.5, 0.4),
        ("run.duration", 12, 13),
        ("uncertainty.dropout", 0, 0.1),
    ],
)
def test_other_keys_must_keep_their_value(origin: Path, key: str, had: object, other: object) -> None:
    file = origin / SCENARIO
    assert strategy_settings([(key, had), ("strategy.reach", 1)], file) == {"reach": 1}
    with pytest.raises(OptionError) as caught:
        strategy_settings([(key, other)], file)
    assert str(caught.value) == (f"--set: {key}; must be strategy.NAME with --from, or the run's own value")


class ReceivedFrame(NamedTuple):
    step: int
    """Step in which the frame ended."""
    sender: str
    receiver: str
    ended: int
    """µs."""


def received(origin: Path, count: int, rng: random.Random, step_us: int) -> list[ReceivedFrame]:
    """Return random frames, each the first of its sender in a step at its receiver."""
    found: dict[tuple[int, str, str], ReceivedFrame] = {}
    for frame in frame_rows(*frame_outcomes(origin)):
        for copy in frame.copies:
            if copy.outcome == "heard":
                key = (frame.ended // step_us, frame.robot, copy.robot)
                found.setdefault(key, ReceivedFrame(*key, frame.ended))
    last = max(found)[0]
    usable = [frame for key, frame in sorted(found.items()) if 0 < key[0] < last]
    return rng.sample(usable, min(count, len(usable)))


@pytest.mark.claim("branches")
@pytest.mark.timeout(600)
def test_random_branches(full: bool, origin: Path, tmp_path: Path) -> None:
    rng, count = random.Random(1), 2
    if full:
        origin, count = tmp_path / "origin", 20
        record(origin, SHIPPED / "scenarios" / "chapter.toml", seed=1, duration=60.0)
    end = json.loads((origin / "run.json").read_text())["simulated_s"]
    for number in range(count):
        options = RunOptions(tmp_path / f"unchanged-{number}", bus="memory")
        made = branch(origin, Change(rng.uniform(0.1, end - 1) if number else 0.1), options, permit=INSTALLED)
        assert (made.result.digest, made.divergence) == (_digest(origin), None)
    for number, frame in enumerate(received(origin, count, rng, STEP_US)):
        at_s = in_seconds(frame.step * STEP_US)
        order = BranchEvent(
            LoseFrame(frame.receiver, frame.sender), at_s, f"lose {frame.receiver} {frame.sender}"
        )
        options = RunOptions(tmp_path / f"frame-{number}", bus="memory")
        lost = branch(origin, Change(at_s, events=(order,)), options, permit=INSTALLED)
        assert lost.divergence is not None and lost.failed_events == ()
        assert (lost.divergence.step, lost.divergence.key) == (frame.step + 1, RECEIVED.key(frame.receiver))
        assert f"instant={frame.ended}" in lost.divergence.words
        assert lost.result.frames_by_robot[frame.receiver]["copies_lost_withheld"] >= 1
