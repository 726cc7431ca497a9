"""What lies beside a result: it says where the result comes from, and gives it again from another folder."""

import json
import platform
import shutil
import subprocess
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

from actors.installation.version import software
from tests.in_process import acrc
from tests.swarm.command import ROOT

STUDY = """
from tests.swarm.witness import behaviour as plain

def behaviour(start):
    return plain(start)
"""


def run(out: Path, *words: object) -> dict[str, Any]:
    """Return the result of `acrc run WORDS… --out OUT`, called in process."""
    done = acrc("run", *words, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def scenario_file(folder: Path) -> Path:
    """A scenario with files of its own: a map, a robot model, a strategy."""
    folder.mkdir()
    for image in (ROOT / "maps").glob("corridor.*"):
        shutil.copy(image, folder)
    shutil.copy(ROOT / "actors/models/turtlebot2.toml", folder / "mine.toml")
    (folder / "my_own_study.py").write_text(STUDY)
    file = folder / "study.toml"
    file.write_text(
        'map = "corridor.yaml"\n[run]\nduration = 2.0\nstrategy = "my_own_study:behaviour"\n'
        '[robots]\ncount = 2\nmodel = "mine.toml"\n'
    )
    return file


def test_a_result_says_where_it_comes_from_and_is_had_again_elsewhere(tmp_path: Path) -> None:
    study = scenario_file(tmp_path / "study")
    first = run(tmp_path / "one" / "out", study, "--trust", "--bus", "memory")
    origin = first["origin"]
    assert origin == json.loads((tmp_path / "one" / "out" / "run.json").read_text())["origin"]
    assert origin["versions"].pop("python") == platform.python_version()
    assert origin["versions"].items() >= {"numpy": version("numpy"), "numba": version("numba")}.items()
    del origin["versions"]
    assert origin == {
        "scenario": "study.toml",
        "strategy": "my_own_study:behaviour",
        "behaviour": "my_own_study:behaviour",
        "settings": {},
        "key": "",
        "commit": software(),
        "navigation": "robust",
        "localisation": "robust",
        "branch": None,
    }
    text = (tmp_path / "one" / "out" / "scenario.toml").read_text()
    assert str(tmp_path) not in text and str(ROOT) not in text
    said = tomllib.loads(text)
    assert said["map"] == "map/map.yaml" and said["run"]["modules"] == "../../study"
    assert said["robots"]["model"] == said["robot"][0]["model"] == "models/1-mine.toml"
    (tmp_path / "one").rename(tmp_path / "two")
    again = run(tmp_path / "again", tmp_path / "two" / "out" / "scenario.toml", "--trust", "--bus", "memory")
    assert again["digest"] == first["digest"]


def test_a_shipped_strategy_needs_nothing_from_outside_of_the_folder(tmp_path: Path) -> None:
    words = ("--bus", "memory", "--duration", 1, "--robots", 1, "--strategy", "chapter")
    first = run(tmp_path / "a" / "out", *words)
    assert first["origin"]["scenario"] == "chapter.toml" and first["origin"]["strategy"] == "chapter"
    said = tomllib.loads((tmp_path / "a" / "out" / "scenario.toml").read_text())
    assert "modules" not in said["run"]
    subprocess.run(["cp", "-r", tmp_path / "a" / "out", tmp_path / "b"], check=True)
    shutil.rmtree(tmp_path / "a")
    again = run(tmp_path / "c", tmp_path / "b" / "scenario.toml", "--bus", "memory")
    assert again["digest"] == first["digest"]
