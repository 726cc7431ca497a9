"""The house test: one scenario and seed give one digest, however the actors are run."""

import os
from pathlib import Path

import pytest

from benchmarks.swarm.crowded_start import busy
from tests.swarm.command import ROOT, acrc, leftovers, processes_of, run

CROWD = Path(__file__).parent / "crowd.toml"
ONE_CORE = ("taskset", "-c", "0")
TOLD = ("digest", "places_done", "places_lost", "contacts", "frames", "deeco", "per_robot")
"""What a result says of the run, and not of how it was made."""
RESTART = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 30.0
strategy = "chapter"
[robots]
count = 3
[[event]]
at = 5.0
kill = "r2"
[[event]]
at = 10.0
restart = "r2"
"""


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    return run(tmp_path_factory.mktemp("memory") / "out", CROWD, "--bus", "memory")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run over Zenoh as `acrc run` makes it, for those who only read it."""
    out = tmp_path_factory.mktemp("zenoh") / "out"
    run(out, CROWD)
    return out


def test_the_scenario_is_hard_enough(reference: dict[str, object]) -> None:
    assert isinstance(reference["contacts"], int) and reference["contacts"] >= 100
    frames = reference["frames"]
    assert isinstance(frames, dict) and frames["copies_heard"] > 100 and frames["frames_access_failure"] > 0
    model = reference["deeco"]
    assert isinstance(model, dict) and model["counters"]["relayed"] > 100
    assert min(model["exchanges"].values()) > 5 and len(model["exchanges"]) == 2


@pytest.mark.parametrize(
    ("words", "before"),
    [
        (("--bus", "memory"), ()),
        (("--bus", "memory"), ONE_CORE),
        (("--isolate",), ()),
        (("--no-isolate",), ()),
        (("--isolate",), ONE_CORE),
        (("--speed", "20"), ()),
        (("--view",), ()),
    ],
    ids=lambda words: " ".join(words) or "-",
)
def test_one_digest(
    reference: dict[str, object], tmp_path: Path, words: tuple[str, ...], before: tuple[str, ...]
) -> None:
    if "--view" in words:
        pytest.importorskip("rerun", reason="`./acrc run --view` installs what shows a run")
    out = tmp_path / "out"
    result = run(out, CROWD, *words, before=before)
    assert result["undelivered"] == result["unread"] == 0
    assert {key: result[key] for key in TOLD} == {key: reference[key] for key in TOLD}
    assert processes_of(out) == [] and leftovers(out) == []


@pytest.mark.parametrize("isolation", ["--isolate", "--no-isolate"])
def test_one_digest_where_every_process_is_started_anew(tmp_path: Path, isolation: str) -> None:
    """Fewer robots, as each imports everything, which takes longer than the run; one is restarted."""
    scenario = tmp_path / "restart.toml"
    scenario.write_text(RESTART)
    reference = run(tmp_path / "memory", scenario, "--bus", "memory")
    out = tmp_path / "anew"
    anew = run(out, scenario, "--spawn", "exec", isolation)
    assert {key: anew[key] for key in TOLD} == {key: reference[key] for key in TOLD}
    assert anew["undelivered"] == anew["unread"] == 0
    assert (out / "r2" / "r2.1.mcap").is_file()
    assert processes_of(out) == [] and leftovers(out) == []


def test_one_digest_beside_a_hog(reference: dict[str, object], tmp_path: Path) -> None:
    with busy(os.cpu_count() or 1):
        assert run(tmp_path / "out", CROWD)["digest"] == reference["digest"]


def test_the_pace_changes_nothing(tmp_path: Path) -> None:
    words = ("--duration", 12, "--robots", 2)
    fast = run(tmp_path / "fast", *words)
    paced = run(tmp_path / "paced", *words, "--speed", 4)
    assert paced["digest"] == fast["digest"]
    assert paced["wall_s"] >= 2.9  # 12 s less the last step, at four times real time


def test_another_seed_step_or_strategy_gives_another_digest(
    reference: dict[str, object], tmp_path: Path
) -> None:
    other = run(tmp_path / "seed", CROWD, "--bus", "memory", "--seed", 6)
    finer = run(tmp_path / "step", CROWD, "--bus", "memory", "--step", 50)
    assert len({reference["digest"], other["digest"], finer["digest"]}) == 3


def test_the_digest_can_be_had_again_from_the_recordings(
    reference: dict[str, object], recorded: Path
) -> None:
    done = acrc("record", "check", recorded)
    assert done.returncode == 0 and str(reference["digest"]) in done.stdout


@pytest.mark.parametrize("actor", ["world", "radio", "r1", "r8", "r8.1"])
def test_every_actor_can_be_replayed(recorded: Path, actor: str) -> None:
    done = acrc("record", "replay", recorded, actor)
    assert done.returncode == 0, done.stderr
    assert "equal" in done.stdout
