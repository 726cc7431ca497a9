"""What a recorded strategy does while a run is explained or exported stays in its process, and is told."""

from pathlib import Path

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.foreign import Permit
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.isolation import sandbox
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import parse
from observation.explanation.asking import decisions, explained
from observation.explanation.explain import ExplanationError, decode, wish
from observation.export.answered import ExportError, read_answer
from observation.export.robot_rows import EXECUTED
from observation.export.rows import tables
from observation.replay.shut_off_calls import Bounds, CallOutcome
from observation.replay.trusted_replay import replay
from tests.swarm.command import processes_of, start

ABLE = sandbox.available() is None
SCENARIO = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"
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
    settled = parse(SCENARIO, REPOSITORY / "hostile.toml")
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out


def fault(out: Path, mood: str, least_s: float = 120.0) -> str:
    """What is said of a decision's explanation when the strategy is in that mood; nothing stays behind."""
    (out / "mood").write_text(mood)
    bounds = Bounds(64_000_000, least_s, bytes_per_s=1e9)
    with pytest.raises(ExplanationError) as caught:
        explained(out, wish("r1@1"), permit=Permit((REPOSITORY,)), isolate=ABLE, bounds=bounds)
    assert processes_of(out) == []
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600
    return str(caught.value)


def test_one_that_hangs_is_ended(hostile: Path) -> None:
    said = fault(hostile, "hang", least_s=2.0)
    assert said == "r1: could not be executed again: what it runs has not ended after 2 s, and was ended"


def test_one_that_hangs_while_it_is_replayed_is_ended(hostile: Path) -> None:
    (hostile / "mood").write_text("hang")
    bounds = Bounds(1000, least_s=2.0, bytes_per_s=1e9)
    with pytest.raises(ReplayError) as caught:
        replay(hostile, "r1", permit=Permit((REPOSITORY,)), isolate=ABLE or None, bounds=bounds)
    assert str(caught.value) == (
        "r1: could not be executed again: what it runs has not ended after 2 s, and was ended"
    )
    assert processes_of(hostile) == []


def test_a_replay_that_lies_is_told(hostile: Path) -> None:
    (hostile / "mood").write_text("much")
    with pytest.raises(ReplayError, match=r"^r1: what it answers makes no sense$"):
        replay(hostile, "r1", permit=Permit((REPOSITORY,)), isolate=ABLE or None)


def test_a_flood_ends_where_a_file_may_be_no_larger(hostile: Path) -> None:
    assert fault(hostile, "flood") == "r1: OSError: [Errno 27] File too large"


@pytest.mark.skipif(not ABLE, reason="this machine cannot shut processes off")
def test_it_sees_neither_the_swarms_code_nor_writes_anywhere(hostile: Path) -> None:
    assert fault(hostile, "peek") == "r1: RuntimeError: sees False False"


def test_one_that_leaves_takes_along_what_it_started(hostile: Path) -> None:
    (hostile / "mood").write_text("leave")
    # what is executed again has words of its own
    process = start("explain", hostile, "r1", "--modules", REPOSITORY)
    told, said = process.communicate(timeout=100)
    assert process.returncode == 1 and told == ""
    assert said.endswith("acrc: r1: could not be executed again (exit code 3)\n")
    assert processes_of(hostile) == []


def test_more_than_an_answer_may_have_is_not_read(hostile: Path) -> None:
    (hostile / "mood").write_text("much")
    with pytest.raises(ExportError) as caught:
        tables(hostile, permit=Permit((REPOSITORY,)), isolate=ABLE, bounds=Bounds(1000))
    assert str(caught.value) == "r1: answers with more than 1000 bytes"


def test_an_explanation_that_lies_is_told() -> None:
    link = {"at_s": 1.0, "kind": "order", "says": "stands", "depth": 0, "about": {}}
    told = {"robot": "r1", "asked_s": 1.0, "at_s": 1.0, "exact": True, "decision": "x", "by": "y"}
    sound = msgspec.msgpack.encode({"explanations": [told | {"chain": [link]}]})
    assert decode("r1", sound).explanations[0].chain[0].says == "stands"
    lies: dict[bytes, str] = {
        b"": "Input data was truncated",
        b"\xc1 no such thing": "MessagePack data is malformed",
        b"\x91" * 100_000: "Expected `object`, got `array`",
        msgspec.msgpack.encode({"explanations": [told | {"robot": "r2", "chain": []}]}): "it is about 'r2'",
        msgspec.msgpack.encode({"explanations": [told | {"chain": [link | {"depth": 10**12}]}]}): "<= 100",
        msgspec.msgpack.encode({"explanations": [told | {"at_s": float("nan"), "chain": []}]}): ">= 0.0",
    }
    for lie, words in lies.items():
        with pytest.raises(ExplanationError) as caught:
            decode("r1", lie)
        assert str(caught.value).startswith("r1: what it answers makes no sense: ")
        assert words in str(caught.value)
    with pytest.raises(ExplanationError, match=r"^a fault \\x1b$"):
        decode("r1", msgspec.msgpack.encode({"fault": "a fault \x1b"}))


def test_an_export_of_other_tables_is_told() -> None:
    with pytest.raises(ExportError, match="r1: what it answers makes no sense: it has the tables 'mine'"):
        read_answer(CallOutcome("r1", msgspec.msgpack.encode({"tables": {"mine": []}})))


GOAL = (3, 0.3, 1.0, 2.0, "active", None, "driving")


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        (GOAL[:-1], "row 0 of goals has 6 cells, and must have 7"),
        ((None, *GOAL[1:]), "step is None in row 0 of goals; must be int"),
        ((True, *GOAL[1:]), "step is True in row 0 of goals; must be int"),
        ((2**63, *GOAL[1:]), "step is 9223372036854775808 in row 0 of goals; must be int"),
        ((*GOAL[:2], "x", *GOAL[3:]), "x is 'x' in row 0 of goals; must be float"),
        ((*GOAL[:4], ["a"], *GOAL[5:]), "status is ['a'] in row 0 of goals; must be text"),
    ],
)
def test_cells_are_held_to_their_columns(row: tuple[object, ...], sentence: str) -> None:
    def answer(row: tuple[object, ...]) -> CallOutcome:
        rows: dict[str, list[object]] = {name: [] for name in EXECUTED} | {"goals": [row]}
        return CallOutcome("r1", msgspec.msgpack.encode({"tables": rows}))

    assert read_answer(answer(GOAL))["goals"] == [GOAL]
    with pytest.raises(ExportError) as caught:
        read_answer(answer(row))
    assert str(caught.value) == f"r1: what it answers makes no sense: {sentence}"


def test_a_robot_that_is_none_is_refused_before_anything_runs(hostile: Path) -> None:
    with pytest.raises(ExplanationError, match="r7: is no robot of this run; there are r1"):
        decisions(hostile, "r7", permit=Permit((REPOSITORY,)), isolate=ABLE)
