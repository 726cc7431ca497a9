"""`--key`: all that is random follows from it, it is recorded, and a run with one can be made again."""

import json
from pathlib import Path
from typing import Any

import pytest

from actors.installation.usage import OptionError
from actors.randomness import derived_seed, keyed_seed
from deploy.scenario.resolve import ResolvedScenario, resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.swarm.command import acrc, run

KEY = "00112233445566778899aabbccddeeff"
OTHER = "ff" * 64
FREE = (("places.preset", "free"),)
"""Drawn, and not those of the original testbed."""
WORDS = ("--robots", 2, "--duration", 3, "--seed", 5)


def settled(key: str | None) -> ResolvedScenario:
    return resolve(load_scenario(None, Overrides(robots=2, seed=5, key=key, settings=FREE)))


def test_a_key_changes_every_seed_and_none_stays_what_it_is_without_one() -> None:
    parts = ("world", "radio", "placement", "robot r1", "robot r2")
    seeds = [keyed_seed(seed, key, part) for seed in (5, 6) for key in (KEY, OTHER) for part in parts]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**63 for seed in seeds)
    assert keyed_seed(5, "", "world") == 5
    assert derived_seed(5, "r1", KEY) == keyed_seed(5, KEY, "robot r1") != derived_seed(5, "r1")


def test_placement_radio_world_and_robots_follow_from_the_key() -> None:
    plain, keyed, again, other = (settled(key) for key in (None, KEY, KEY.upper(), OTHER))
    assert keyed.world.robots == again.world.robots
    for one in (plain, other):
        assert keyed.world.robots != one.world.robots
        assert keyed.radio.seed != one.radio.seed
        assert keyed.world.world_seed != one.world.world_seed
        assert keyed.world.robot_seed("r1") != one.world.robot_seed("r1")
    assert (plain.world.seed, plain.world.world_seed, plain.radio.seed) == (5, 5, 5)
    assert plain.world.robot_seed("r1") == derived_seed(5, "r1")
    assert keyed.world.seed == 5  # what a person calls the run


@pytest.mark.parametrize("key", ["0011", KEY + "0", KEY[:-1] + "g", "12345678901234567890"])
def test_a_key_that_is_none_is_refused_in_a_sentence(key: str) -> None:
    with pytest.raises(OptionError) as caught:
        load_scenario(None, Overrides(key=key))
    assert str(caught.value) == (
        f"--key: {key}; must be 32 to 128 hexadecimal digits, an even number, as of `openssl rand -hex 16`"
    )


def test_a_run_with_a_key_is_made_again_from_its_folder(tmp_path: Path) -> None:
    there = run(tmp_path / "keyed", *WORDS, "--key", KEY)
    here = run(tmp_path / "memory", *WORDS, "--key", KEY, "--bus", "memory")
    again = run(tmp_path / "again", tmp_path / "keyed" / "scenario.toml", "--bus", "memory")
    without = run(tmp_path / "without", *WORDS, "--bus", "memory")
    assert there["digest"] == here["digest"] == again["digest"] != without["digest"]
    assert [_key(one) for one in (there, here, again, without)] == [KEY, KEY, KEY, ""]
    assert {one["seed"] for one in (there, here, again, without)} == {5}
    setup = (tmp_path / "keyed" / "world" / "setup.json").read_bytes()
    assert json.loads(setup)["actor"]["key"] == KEY
    for words in (("record", "check", tmp_path / "keyed"), ("replay", tmp_path / "keyed")):
        done = acrc(*words)
        assert done.returncode == 0, done.stderr
    branch = acrc("branch", f"{tmp_path / 'keyed'}@1", "--out", tmp_path / "branch", "--json")
    assert branch.returncode == 0, branch.stderr
    assert json.loads(branch.stdout)["digest"] == there["digest"]
    for file in (tmp_path / "keyed").glob("r?/*"):
        assert file.is_dir() or KEY.encode() not in file.read_bytes(), file


def _key(result: dict[str, Any]) -> str:
    key: str = result["origin"]["key"]
    return key
