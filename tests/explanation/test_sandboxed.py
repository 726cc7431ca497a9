"""Containment of recorded strategies during replays: process, limits, forged answers."""

from pathlib import Path

import msgspec
import pytest

from acrc_testbed.explanation.causal_trace import TraceError, decode
from acrc_testbed.explanation.explainer import Explainer, ExplanationError
from acrc_testbed.explanation.trace_replay import trace_here
from acrc_testbed.recordings.record_replay import ReplayOptions
from acrc_testbed.recordings.sandboxed_replay import ProgramLimits, replay
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.code_permit import Permit
from actors.runtime.isolation import sandbox
from actors.runtime.replay_bus import ReplayError
from tests.recorded_runs import record
from tests.swarm.command import processes_of, start

ABLE = sandbox.isolation_fault() is None
CONFINED = pytest.mark.skipif(not ABLE, reason="this machine cannot confine processes")
SCENARIO = """
map = "../maps/corridor.yaml"
[run]
duration = 1.0
strategy = "tests.explanation.hostile:behaviour"
[robots]
count = 1
[localisation]
preset = "odometry"
[places]
preset = "golden"
per_robot = 1
"""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("hostile") / "out"
    record(out, SCENARIO)
    return out


@pytest.mark.parametrize(
    ("mood", "sentence"),
    [
        pytest.param("peek", "r1: RuntimeError: sees False False", marks=CONFINED),
        pytest.param("flood", "r1: OSError: [Errno 27] File too large", marks=pytest.mark.nightly),
        ("hang", "r1: replay timed out after 2 s and was killed"),
    ],
)
def test_a_strategy_stays_in_its_process_within_its_limits(hostile: Path, mood: str, sentence: str) -> None:
    (hostile / "mood").write_text(mood)
    bounds = ProgramLimits(64_000_000, 2.0 if mood == "hang" else 120.0, bytes_per_s=1e9)
    with pytest.raises(ExplanationError) as caught:
        Explainer(hostile, "r1", permit=Permit((REPOSITORY,)), isolate=ABLE, bounds=bounds)
    assert str(caught.value) == sentence
    assert processes_of(hostile) == []


def test_a_malformed_answer_of_a_replay_is_an_error(hostile: Path) -> None:
    (hostile / "mood").write_text("much")
    with pytest.raises(ReplayError, match=r"^r1: invalid answer of the replay$"):
        replay(hostile, "r1", permit=Permit((REPOSITORY,)), isolate=ABLE or None)


def test_children_of_an_exited_replay_are_killed(hostile: Path) -> None:
    (hostile / "mood").write_text("leave")
    process = start("explain", hostile, "r1", "--modules", REPOSITORY)
    told, said = process.communicate(timeout=100)
    assert process.returncode == 1 and told == ""
    assert said.endswith("acrc: r1: replay failed (exit code 3)\n")
    assert processes_of(hostile) == []


@pytest.mark.nightly
def test_an_answer_beyond_its_limit_is_rejected(hostile: Path) -> None:
    (hostile / "mood").write_text("much")
    with pytest.raises(ExplanationError) as caught:
        Explainer(hostile, "r1", permit=Permit((REPOSITORY,)), isolate=ABLE, bounds=ProgramLimits(1000))
    assert str(caught.value) == "r1: answer is larger than 1000 bytes"


def test_a_forged_trace_is_rejected(hostile: Path) -> None:
    (hostile / "mood").write_text("")
    sound = msgspec.msgpack.decode(msgspec.msgpack.encode(trace_here(hostile, "r1", ReplayOptions())))
    news = {"peer": "r2", "heard": 3}
    assert decode(msgspec.msgpack.encode(sound | {"news": [news]}), "r1").news[0].heard == 3
    lies = {
        b"": "Input data was truncated",
        b"\xc1 no such thing": "MessagePack data is malformed",
        msgspec.msgpack.encode(sound | {"news": [news | {"heard": -1}]}): (
            "news[0].heard is -1, but must be a whole number of at least 0"
        ),
        msgspec.msgpack.encode(sound | {"has_nodes": "x"}): 'has_nodes is "x", but must be',
    }
    for lie, words in lies.items():
        with pytest.raises(TraceError) as caught:
            decode(lie, "r1")
        assert str(caught.value).startswith("r1: invalid trace: ")
        assert words in str(caught.value)


def test_an_unknown_robot_is_rejected_before_a_replay(hostile: Path) -> None:
    with pytest.raises(ExplanationError, match="r7: not a robot of this run; choose from r1"):
        Explainer(hostile, "r7", permit=Permit((REPOSITORY,)), isolate=ABLE)
