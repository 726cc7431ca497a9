"""Every option of every command, called with a right value: it does something, and the command ends well.

An option that no line of `tests.cli.stories` has is a failure, and each line is run.
"""

import json
import os
import shlex
from pathlib import Path

import pytest

from command_line.documentation.commands import tree
from tests import warm
from tests.cli.stories import NIGHTLY, STORIES
from tests.cli.story import ROOT, Line, tell
from tests.experiments.test_cluster import cluster
from tests.fleet.test_watch import unused
from tests.onboard.test_hardware_in_the_loop import SCENARIO
from tests.onboard.test_live import links
from tests.radio.test_truth import HEAD, RUNS

TREE = tree()
MINE = """
from dataclasses import replace
from actors.robot.behaviour import host
from cleaning.place import assignments
from cleaning.robot import CleaningRobot
from deeco import component, periodic, seconds

@component
class Mine(CleaningRobot):
    looked: bool = False

    @periodic(every=seconds(1), order=9)
    def look(self):
        print(self.id, "looks")
        return replace(self, looked=True)

def behaviour(start):
    return host(start, Mine(id=start.robot, position=start.pose.point, route=assignments(start)))
"""
"""A strategy of one's own, in which a debugger can stop."""
DEBUGPY = """
import runpy, sys

def listen(address): print("an editor may attach at", address[1])
def wait_for_client(): print("it does")
def breakpoint(): print("it stops")

if __name__ == "__main__":  # python -m debugpy --listen PORT -m MODULE ...
    del sys.argv[:4]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""
"""Stands for the package that lets an editor in, which the suite does not install."""
STUDY = """
scenario = "own.toml"
strategies = ["mine:behaviour"]
seeds = 1
"""
OWN = """
map = "maps/corridor.yaml"
[run]
strategy = "mine:behaviour"
duration = 1.0
[robots]
count = 1
"""
FLEET = """
map = "maps/corridor.yaml"
keys = "keys"
[run]
strategy = "mine:behaviour"
[[robot]]
id = "r1"
address = 1
start = [12.0, 13.0, 0.0]
places = [[20.0, 12.5], [4.0, 12.5]]
base = "{links}/base"
radio = "{links}/board1"
range = "{links}/range"
listen = "{listen}"
"""
__all__ = ["cluster", "links"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What a clone has, a strategy of one's own, and what some benchmarks compare with."""
    for name in ("scenarios", "maps", "fleets", "studies"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "near.toml").write_text(SCENARIO)
    (tmp_path / "own.toml").write_text(OWN)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "b_single_saturated.csv").write_text("\n".join([HEAD, *RUNS]) + "\n")
    told = [{"log": "l", "runs": [{"rmse": 0.1, "lost": False, "nmed": 0.2, "updates": 12}]}]
    (tmp_path / "theirs.json").write_text(json.dumps(told))
    (tmp_path / "stand-ins").mkdir()
    (tmp_path / "stand-ins" / "debugpy.py").write_text(DEBUGPY)
    return tmp_path


MARKED = [pytest.param(name, marks=pytest.mark.nightly if name in NIGHTLY else ()) for name in STORIES]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("story", MARKED)
def test_every_line_does_what_it_should(story: str, folder: Path, request: pytest.FixtureRequest) -> None:
    given = {"listen": unused(), "root": str(ROOT)}
    if story in {"fleet", "told"}:
        given["links"] = str(request.getfixturevalue("links"))
        (folder / "f.toml").write_text(FLEET.format_map(given))
    if story == "cluster":
        given["cluster"] = request.getfixturevalue("cluster").address
    told = {
        "HOME": str(folder), "BROWSER": "true",
        "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "" if story == "docs" else "1",  # it is in a page
        "PYTHONPATH": f"{ROOT}{os.pathsep}{folder / 'stand-ins'}", "COLUMNS": "200",
        "DASK_CONFIG": str(folder / "keys"),
    }  # fmt: skip
    program = "tests.cli.small_benchmarks" if story == "bench" else warm.ACRC
    tell(STORIES[story], folder, given, {**os.environ, **told}, program)


def test_every_option_of_every_command_is_in_a_line() -> None:
    given = {option for lines in STORIES.values() for line in lines for option in options(line)}
    wanted = {
        (called, name)
        for called, command in TREE.items()
        for one in command.params
        if one.param_type_name == "option" and "--help" not in one.opts
        for name in (max(one.opts, key=len), *one.secondary_opts)
    }
    assert sorted(wanted - given) == []


def options(line: Line) -> set[tuple[str, str]]:
    """The options of a line, each with the words of its command."""
    called, words = "acrc", shlex.split(line.words)
    while words and f"{called} {words[0]}" in TREE:
        called = f"{called} {words.pop(0)}"
    return {(called, word.partition("=")[0]) for word in words if word.startswith("--")}


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("run a.toml --seed 3 --json", {("acrc run", "--seed"), ("acrc run", "--json")}),
        ("fleet onboard f --at=start", {("acrc fleet onboard", "--at")}),
        ("order a kill r1", set()),
    ],
)
def test_what_a_line_calls_is_read_as_the_command_line_is(words: str, found: set[tuple[str, str]]) -> None:
    assert options(Line(words)) == found
    assert warm.ACRC == "command_line.app"
