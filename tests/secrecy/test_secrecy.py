"""What a robot that is shut off can find out of its run: neither scenario, nor folder, nor seed."""

import json
import secrets
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.randomness import derived_seed, keyed_seed
from tests.isolation.test_attacks import need_isolation
from tests.secrecy.snoop import CIPHER
from tests.swarm.command import acrc, start

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


def look_around(folder: Path, *words: str) -> tuple[Path, list[str]]:
    """A run of a strategy that looks for all that could tell it of the run: its folder, and what it found."""
    study, scenario, run = (secrets.token_hex(8) for _ in range(3))  # in no file of this project
    seed = secrets.randbelow(2**62) + 2**62
    (folder / study).mkdir()
    file = folder / study / f"{scenario}.toml"
    file.write_text(SCENARIO.format(map=REPOSITORY / "maps" / "corridor.yaml", seed=seed))
    shutil.copy(Path(__file__).with_name("snoop.py"), folder / study)
    names = [word.encode() for word in (study, scenario, run)]
    others = [derived_seed(seed, "r1", key) for key in ("", KEY)]  # r2 is who looks
    parts = [keyed_seed(seed, KEY, part) for part in ("world", "radio", "placement")]
    sought = [*names, *(form for number in (seed, *others, *parts) for form in forms(number)), KEY.encode()]
    told = [word.translate(CIPHER).hex() for word in (*sought, bytes.fromhex(KEY))]
    (folder / study / "words.json").write_text(json.dumps(told))
    # A process as a user starts it: tests otherwise fork it from one that knows what is asked of it.
    words = (*words, "--trust", "--json", "--timeout", "250", "--out", str(folder / run))
    process = start("run", file, *words)
    assert process.wait(timeout=300) == 0, process.communicate()
    (found,) = (*folder.glob("*/found.json"), *folder.glob("*/r2/own/found.json"))
    return folder / run, json.loads(found.read_text())


def forms(number: int) -> Sequence[bytes]:
    """How a number of 63 bits may stand in a text or in memory."""
    return (f"{number}".encode(), f"{number:x}".encode(), *(number.to_bytes(8, e) for e in ("little", "big")))


@pytest.mark.parametrize(
    "words", [("--spawn", "forkserver", "--key", KEY), ("--spawn", "exec")], ids=["fork", "exec"]
)
def test_nothing_that_a_robot_can_reach_tells_of_scenario_folder_or_seed(
    tmp_path: Path, words: Sequence[str]
) -> None:
    need_isolation()
    out, found = look_around(tmp_path, "--isolate", *words)
    assert json.loads((out / "run.json").read_bytes())["isolation"] == "full"
    assert found == []
    again = acrc("replay", out, "--robot", "r1", "--trust")  # by the names that only the run's folder knows
    assert again.returncode == 0, again.stderr


def test_who_looks_finds_what_is_not_hidden(tmp_path: Path) -> None:
    _, found = look_around(tmp_path, "--no-isolate")
    places = {line.partition(":")[0].partition(",")[0] for line in found}
    assert {"memory", "frame main"} - places == set(), places
