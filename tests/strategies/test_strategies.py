"""User strategies on the command line: installed, beside the scenario, with settings, and faulty."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from actors.robot.program import load_setup
from tests import in_process
from tests.swarm.command import ROOT, acrc, run

WANDERER = '''
"""Robots that go from one random place to the next."""
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from actors.instant import Duration, Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, GoalOrder, Start, View
from actors.robot.behaviour import from_settings

@dataclass(frozen=True)
class Parameters:
    pause: Duration = seconds(1)

class Wanderer:
    def __init__(self, start: Start) -> None:
        self.floor, self.next = start.floor, 0
        self.pause = from_settings(Parameters, start.settings).pause

    def advance(self, view: View, until: Instant) -> Decision:
        if view.instant < self.next:
            return Decision()
        self.next = view.instant + self.pause
        return Decision(goal=self.floor.random_point())

def behaviour(start: Start) -> Behaviour:
    """Goes from one random place to the next.

    This is its second line.
    """
    with suppress(OSError):
        Path(__file__).with_name("mark").write_text("this ran with the user's rights")
    return Wanderer(start)

def buggy(start: Start) -> Behaviour:
    raise ZeroDivisionError("my strategy divides by the number of its friends")
'''


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder on Python's path, like site-packages."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "wanderer.py").write_text(WANDERER)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return folder


def install(site: Path, name: str, **strategies: str) -> None:
    """Create a distribution that registers strategies, as installed by pip."""
    info = site / f"{name}-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    lines = "".join(f"{key} = {entry}\n" for key, entry in strategies.items())
    (info / "entry_points.txt").write_text(f"[acrc.strategies]\n{lines}")


def listed() -> dict[tuple[str, str], dict[str, Any]]:
    done = acrc("list", "strategies", "--json")
    assert done.returncode == 0, done.stderr
    return {(one["name"], one["source"]): one for one in json.loads(done.stdout)}


def test_installed_strategies_are_listed_beside_the_shipped_ones(site: Path) -> None:
    install(site, "my_study", wander="wanderer:behaviour")
    install(site, "sad_study", lost="no_such_module:behaviour", broken="broken:behaviour")
    (site / "broken.py").write_text("print('loud')\nimport no_such_library\n")
    everyone = listed()
    assert everyone["none", "shipped"]["entry"] == "cleaning.strategies.none:behaviour"
    assert all(one["summary"] and not one["error"] for one in everyone.values() if one["source"] == "shipped")
    wander = everyone["wander", "my_study 1.2"]
    assert (wander["entry"], wander["error"]) == ("wanderer:behaviour", "")
    assert wander["summary"] == "Goes from one random place to the next."
    assert "there is no module 'no_such_module' on" in everyone["lost", "sad_study 1.2"]["error"]
    assert "broken imports 'no_such_library', which is not" in everyone["broken", "sad_study 1.2"]["error"]


def test_an_installed_strategy_runs_by_its_name_in_sandboxes(site: Path, tmp_path: Path) -> None:
    install(site, "my_study", wander="wanderer:behaviour")
    words = ("--strategy", "wander", "--duration", 3, "--robots", 2)
    isolated = run(tmp_path / "isolated", *words, "--isolate")
    memory = run(tmp_path / "memory", *words, "--bus", "memory")
    assert isolated["digest"] == memory["digest"]
    assert isolated["isolation"] == "full"


def test_a_name_registered_twice_is_rejected_when_used(site: Path, tmp_path: Path) -> None:
    install(site, "bold_study", none="wanderer:behaviour", wander="wanderer:behaviour")
    install(site, "my_study", wander="wanderer:behaviour")
    done = acrc("run", ROOT / "scenarios" / "corridor.toml", "--out", tmp_path / "out")
    assert done.returncode == 1 and done.stderr.startswith(
        "acrc: strategy 'none' is the name of a shipped strategy, but is registered by bold_study 1.2, too;"
    )
    done = acrc("run", "--strategy", "wander", "--out", tmp_path / "out")
    assert done.returncode == 2 and "'wander' is registered by bold_study 1.2 and my_study 1.2" in done.stderr


def own_scenario(folder: Path, text: str = "") -> Path:
    folder.mkdir()
    (folder / "wanderer.py").write_text(WANDERER)
    path = folder / "own.toml"
    path.write_text(
        f"map = '{ROOT}/maps/corridor.yaml'\n[robots]\ncount = 2\n[places]\nareas = ['right']\n"
        f"[run]\nduration = 3.0\nstrategy = 'wanderer:behaviour'\n{text}\n"
        "[[area]]\nname = 'left'\nx = [2.25, 4.75]\ny = [11.1, 13.75]\n"
        "[[area]]\nname = 'right'\nx = [15.75, 23.75]\ny = [11.1, 13.75]\n"
    )
    return path


def test_a_module_beside_the_scenario_runs_alike_everywhere_and_is_replayed(tmp_path: Path) -> None:
    path = own_scenario(tmp_path / "study", "[strategy]\npause = 0.5")
    mark, module = tmp_path / "study" / "mark", tmp_path / "study" / "wanderer.py"
    memory = run(tmp_path / "memory", path, "--trust", "--bus", "memory")
    mark.unlink()  # runs in memory are not isolated
    assert run(tmp_path / "isolated", path, "--trust", "--isolate")["digest"] == memory["digest"]
    assert not mark.exists(), "neither dry-run nor run outside of the sandbox"
    again = run(tmp_path / "again", tmp_path / "isolated" / "scenario.toml", "--trust", "--bus", "memory")
    assert again["digest"] == memory["digest"], "with its module, its settings and its areas"
    mark.unlink()
    file = tmp_path / "isolated" / "r2" / "setup.json"
    told = load_setup(file).actor.adaptation
    assert told.settings == {"pause": 0.5} and [area.name for area in told.areas] == ["right"]
    assert b"left" not in file.read_bytes()
    asked = in_process.acrc("replay", tmp_path / "isolated", "--robot", "r2")
    assert asked.stderr.endswith(f"read it, then add --modules {tmp_path}/study, or --trust\n")
    named = ("--modules", tmp_path / "study")
    replayed = acrc("replay", tmp_path / "isolated", "--robot", "r2", *named)
    assert (replayed.returncode, replayed.stderr) == (0, "") and not mark.exists()
    then, now = (hashlib.sha256(text.encode()).hexdigest()[:12] for text in (WANDERER, WANDERER + "# new\n"))
    module.write_text(WANDERER + "# new\n")
    for out, words in (("isolated", ("--robot", "r2")), ("memory", ())):
        changed = in_process.acrc("replay", tmp_path / out, *words, *named)
        sums = f"sha256 {now}, recorded {then}"
        assert changed.stderr.startswith(
            f"acrc: {module}: differs from the file of the recorded run: {sums}; "
        )
    assert acrc("replay", tmp_path / "isolated", "--robot", "r2", "--trust").returncode == 0


def test_errors_of_a_strategy_are_reported_before_anything_is_written(tmp_path: Path) -> None:
    path = own_scenario(tmp_path / "study", "[strategy]\npauze = 0.5")
    done = in_process.acrc("run", path, "--out", tmp_path / "out")
    assert done.returncode == 1 and done.stderr.startswith(f"acrc: {path}: strategy wanderer:behaviour: ")
    assert done.stderr.endswith(f"read it, then add --modules {tmp_path}/study, or --trust\n")
    done = acrc("run", path, "--trust", "--out", tmp_path / "out")
    assert (done.returncode, done.stdout, done.stderr) == (
        1, "", "acrc: unknown key strategy.pauze; did you mean strategy.pause?\n"
    )  # fmt: skip
    # settings of the file are used for its own strategy only
    done = acrc("run", path, "--trust", "--strategy", "wanderer:buggy", "--out", tmp_path / "out")
    assert done.returncode == 1
    *traceback, cause, last = done.stderr.splitlines()
    assert traceback[0] == "Traceback (most recent call last):"
    assert cause == "ZeroDivisionError: my strategy divides by the number of its friends"
    assert last == f"acrc: strategy 'wanderer:buggy', preflight for r1: {cause} (wanderer.py:35)"
    assert not (tmp_path / "out").exists()
