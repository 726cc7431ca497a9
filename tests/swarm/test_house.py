"""The house test: one scenario and seed give one digest, however the actors are run."""

import os
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay.record_replay import replay_actor
from tests.swarm.command import ROOT, acrc, leftovers, processes_of, run
from tests.swarm.test_crowded_start import busy

CROWD = Path(__file__).parent / "crowd.toml"
ONE_CORE = (0,)
SHORT_S = 5.0
"""What differs in so short a run does so in any longer one: a digest is over all messages."""
TOLD = ("digest", "places_done", "places_lost", "contacts", "frames", "deeco", "per_robot")
"""What a result says of the run, and not of how it was made."""
EVENTS = """
[[event]]
at = 4.0
jam = [14.5, 11.0]
radius = 4.0
duration = 2.0
[[event]]
at = 6.0
kill = "r8"
[[event]]
at = 9.0
restart = "r8"
[[event]]
at = 10.0
freeze = "r2"
[[event]]
at = 12.0
thaw = "r2"
"""
"""The crowd's in quick succession; the robots' exchanges are in the runs of its whole length."""
RESTART = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 8.0
strategy = "chapter"
[robots]
count = 2
[[event]]
at = 3.0
kill = "r2"
[[event]]
at = 5.0
restart = "r2"
"""


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    return run(tmp_path_factory.mktemp("memory") / "out", CROWD, "--bus", "memory")


class Run(NamedTuple):
    out: Path
    result: dict[str, Any]


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The crowd with all that can happen to it within 14 s, and its result in memory."""
    folder = tmp_path_factory.mktemp("eventful")
    crowd = CROWD.read_text().partition("[[event]]")[0]
    for told, meant in (
        ("duration = 65.0", "duration = 14.0"),
        ("../../maps", f"{ROOT}/maps"),
        ("blind.toml", f"{CROWD.parent}/blind.toml"),
    ):
        assert told in crowd
        crowd = crowd.replace(told, meant)
    scenario = folder / "eventful.toml"
    scenario.write_text(crowd + EVENTS)
    return Run(scenario, run(folder / "memory", scenario, "--bus", "memory"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run over Zenoh, isolated, for those who only look at what it left."""
    out = tmp_path_factory.mktemp("zenoh") / "out"
    return Run(out, run(out, CROWD, "--isolate"))


def check_one_digest(reference: dict[str, object], made: Run) -> None:
    result = made.result
    assert result["undelivered"] == result["unread"] == 0
    assert {key: result[key] for key in TOLD} == {key: reference[key] for key in TOLD}
    assert processes_of(made.out) == [] and leftovers(made.out) == []


def test_the_scenario_is_hard_enough(reference: dict[str, object]) -> None:
    assert isinstance(reference["contacts"], int) and reference["contacts"] >= 100
    frames = reference["frames"]
    assert isinstance(frames, dict) and frames["copies_heard"] > 100 and frames["frames_access_failure"] > 0
    model = reference["deeco"]
    assert isinstance(model, dict) and model["counters"]["relayed"] > 100
    assert min(model["exchanges"].values()) > 5 and len(model["exchanges"]) == 2


def test_all_its_events_tell(eventful: Run) -> None:
    frames = eventful.result["frames"]
    assert frames["copies_lost_disturbed"] > 0 and frames["copies_lost_collision"] > 0
    assert eventful.result["contacts"] > 40 and eventful.result["deeco"]["counters"]["relayed"] > 100


@pytest.mark.parametrize(
    ("words", "cores"),
    [
        (("--bus", "memory"), ONE_CORE),
        (("--isolate",), ONE_CORE),
        pytest.param(("--speed", "20"), (), marks=pytest.mark.nightly),  # by day: at four times real time
        (("--view",), ()),
    ],
    ids=lambda words: " ".join(map(str, words)) or "-",
)
def test_one_digest(eventful: Run, tmp_path: Path, words: tuple[str, ...], cores: tuple[int, ...]) -> None:
    if "--view" in words:
        pytest.importorskip("rerun", reason="`./acrc run --view` installs what shows a run")
    scenario, reference = eventful
    out = tmp_path / "out"
    check_one_digest(reference, Run(out, run(out, scenario, *words, cores=cores)))


def test_one_digest_where_robots_are_not_isolated(eventful: Run, tmp_path: Path) -> None:
    scenario, reference = eventful
    out = tmp_path / "out"
    check_one_digest(reference, Run(out, run(out, scenario, "--no-isolate")))


def test_one_digest_where_robots_are_isolated(reference: dict[str, object], recorded: Run) -> None:
    assert recorded.result["isolation"] == "full"
    check_one_digest(reference, recorded)


@pytest.fixture(scope="module")
def restarted(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The scenario with a restart, and its result in memory."""
    folder = tmp_path_factory.mktemp("restart")
    scenario = folder / "restart.toml"
    scenario.write_text(RESTART)
    return Run(scenario, run(folder / "memory", scenario, "--bus", "memory"))


@pytest.mark.parametrize("isolation", ["--isolate", pytest.param("--no-isolate", marks=pytest.mark.nightly)])
def test_one_digest_where_every_process_is_started_anew(
    restarted: Run, tmp_path: Path, isolation: str
) -> None:
    """Fewer robots, as each imports everything, which takes longer than the run; one is restarted."""
    scenario, reference = restarted
    out = tmp_path / "anew"
    check_one_digest(reference, Run(out, run(out, scenario, "--spawn", "exec", isolation)))
    assert (out / "r2" / "r2.1.mcap").is_file()


@pytest.mark.claim("crowded-start")
def test_one_digest_beside_a_hog(eventful: Run, tmp_path: Path) -> None:
    scenario, reference = eventful
    with busy(os.cpu_count() or 1):
        assert run(tmp_path / "out", scenario)["digest"] == reference["digest"]


def test_the_pace_changes_nothing(tmp_path: Path) -> None:
    words = ("--duration", 6, "--robots", 2)
    fast = run(tmp_path / "fast", *words)
    paced = run(tmp_path / "paced", *words, "--speed", 4)
    assert paced["digest"] == fast["digest"]
    assert paced["wall_s"] >= 1.4  # 6 s less the last step, at four times real time


def test_another_seed_step_or_strategy_gives_another_digest(tmp_path: Path) -> None:
    changes = (Overrides(seed=6), Overrides(step=50), Overrides(strategy="none"))
    first, again, *others = [
        short_digest(change, tmp_path / str(number))
        for number, change in enumerate((Overrides(), Overrides(), *changes))
    ]
    assert first == again
    assert len({first, *others}) == 1 + len(changes)


def short_digest(overrides: Overrides, out: Path) -> str:
    """Of the crowd's first seconds in memory, without its events."""
    crowd = load_scenario(CROWD, overrides)
    short = crowd.model_copy(update={"run": crowd.run.model_copy(update={"duration": SHORT_S}), "event": ()})
    plan = swarm.plan(short, RunOptions(out, bus="memory"))
    result = swarm.run_in_memory(plan, lambda progress: None)
    assert result.simulated_s == SHORT_S
    return result.digest


def test_the_digest_can_be_had_again_from_the_recordings(reference: dict[str, object], recorded: Run) -> None:
    done = acrc("record", "check", recorded.out)
    assert done.returncode == 0 and str(reference["digest"]) in done.stdout


@pytest.mark.parametrize("actor", ["world", "radio", "r1", "r8"])
def test_every_actor_can_be_replayed(recorded: Run, actor: str) -> None:
    assert replay_actor(recorded.out, actor).outputs > 100


def test_a_robot_that_was_started_again_is_replayed_by_the_command(recorded: Run) -> None:
    done = acrc("replay", recorded.out, "--robot", "r8.1")
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"r8\.1: identical: \d+ outputs\n", done.stdout)
