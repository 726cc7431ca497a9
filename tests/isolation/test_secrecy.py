"""A sandboxed robot learns neither scenario nor run nor seed; `--key` determines all random streams."""

import json
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.randomness import derived_seed, keyed_seed
from deploy.scenario.resolve import ResolvedScenario, resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.isolation.snoop import CIPHER
from tests.isolation.test_attacks import need_isolation
from tests.swarm.command import acrc, run, start

SCENARIO = """
map = "{map}"
[run]
duration = 0.2
seed = {seed}
strategy = "snoop:behaviour"
[robots]
count = 2
[places]
preset = "golden"
per_robot = 1
"""
KEY = secrets.token_hex(16)


def search(folder: Path, *words: str) -> tuple[Path, list[str]]:
    study, scenario, name = (secrets.token_hex(8) for _ in range(3))  # in no file of this project
    seed = secrets.randbelow(2**62) + 2**62
    (folder / study).mkdir()
    file = folder / study / f"{scenario}.toml"
    file.write_text(SCENARIO.format(map=REPOSITORY / "maps" / "corridor.yaml", seed=seed))
    shutil.copy(Path(__file__).with_name("snoop.py"), folder / study)
    names = [word.encode() for word in (study, scenario, name)]
    others = [derived_seed(seed, "r1", key) for key in ("", KEY)]  # r2 searches
    parts = [keyed_seed(seed, KEY, part) for part in ("world", "radio", "placement")]
    sought = [*names, *(form for number in (seed, *others, *parts) for form in forms(number)), KEY.encode()]
    hidden = [word.translate(CIPHER).hex() for word in (*sought, bytes.fromhex(KEY))]
    (folder / study / "words.json").write_text(json.dumps(hidden))
    # A process as a user starts it: other tests fork it from one that knows the command line.
    words = (*words, "--key", KEY, "--trust", "--json", "--timeout", "250", "--out", str(folder / name))
    process = start("run", file, *words)
    assert process.wait(timeout=300) == 0, process.communicate()
    (found,) = (*folder.glob("*/found.json"), *folder.glob("*/r2/own/found.json"))
    return folder / name, json.loads(found.read_text())


def forms(number: int) -> Sequence[bytes]:
    return (f"{number}".encode(), f"{number:x}".encode(), *(number.to_bytes(8, e) for e in ("little", "big")))


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder with a shorter path than pytest's: sockets are in it."""
    with tempfile.TemporaryDirectory(prefix="acrc-", dir="/tmp") as name:
        yield Path(name)


def test_a_sandboxed_robot_finds_neither_scenario_nor_folder_nor_seed(short_path: Path) -> None:
    need_isolation()
    out, found = search(short_path, "--isolate")
    assert json.loads((out / "run.json").read_bytes())["isolation"] == "full"
    assert found == []
    for file in out.glob("r?/*"):
        assert file.is_dir() or KEY.encode() not in file.read_bytes(), file
    again = acrc("replay", out, "--robot", "r1", "--trust")  # with paths from names.json
    assert again.returncode == 0, again.stderr


def test_without_a_sandbox_the_search_finds_them(tmp_path: Path) -> None:
    _, found = search(tmp_path, "--bus", "memory")
    assert any(line.startswith("frame main") for line in found), found


def settled(key: str | None) -> ResolvedScenario:
    free = (("places.preset", "free"),)  # drawn places
    return resolve(load_scenario(None, Overrides(robots=2, seed=5, key=key, settings=free)))


def test_placement_radio_world_and_robots_follow_from_the_key() -> None:
    other = "ff" * 64
    parts = ("world", "radio", "placement", "robot r1", "robot r2")
    seeds = [keyed_seed(seed, key, part) for seed in (5, 6) for key in (KEY, other) for part in parts]
    assert len(set(seeds)) == len(seeds) and all(0 <= seed < 2**63 for seed in seeds)
    assert derived_seed(5, "r1", KEY) == keyed_seed(5, KEY, "robot r1") != derived_seed(5, "r1")
    plain, keyed, again, different = (settled(key) for key in (None, KEY, KEY.upper(), other))
    assert keyed.world.robots == again.world.robots
    for one in (plain, different):
        assert keyed.world.robots != one.world.robots
        assert keyed.radio.seed != one.radio.seed
        assert keyed.world.world_seed != one.world.world_seed
        assert keyed.world.robot_seed("r1") != one.world.robot_seed("r1")
    assert (plain.world.seed, plain.world.world_seed, plain.radio.seed) == (5, 5, 5)
    assert plain.world.robot_seed("r1") == derived_seed(5, "r1")
    assert keyed.world.seed == 5


@pytest.mark.parametrize("key", ["0011", KEY + "0", KEY[:-1] + "g"], ids=["short", "odd", "not hex"])
def test_a_malformed_key_is_refused(key: str) -> None:
    with pytest.raises(OptionError, match=r"must be 32 to 128 hexadecimal digits"):
        load_scenario(None, Overrides(key=key))


def test_a_run_with_a_key_is_repeated_from_its_folder(tmp_path: Path) -> None:
    words = ("--robots", 2, "--duration", 3, "--seed", 5)
    keyed = run(tmp_path / "keyed", *words, "--key", KEY, "--bus", "memory")
    again = run(tmp_path / "again", tmp_path / "keyed" / "scenario.toml", "--bus", "memory")
    without = run(tmp_path / "without", *words, "--bus", "memory")
    assert keyed["digest"] == again["digest"] != without["digest"]
    assert [one["origin"]["key"] for one in (keyed, again, without)] == [KEY, KEY, ""]
    replayed = acrc("replay", tmp_path / "keyed")
    assert replayed.returncode == 0, replayed.stderr
