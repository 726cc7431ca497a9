"""What would have come of a run without what kept its robots: a dead robot and a closed door."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.errors import AcrcError
from command_line.app import app
from deploy.branches.what_if import omissions, what_if
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import parse
from observation.accounting.account import account
from observation.accounting.time_spent import Cause, WhatIf

SCENARIO = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"
[run]
duration = 20.0
seed = 1
strategy = "none"
[navigation]
preset = "robust"
[robots]
count = 3
[[robot]]
id = "r1"
start = [12.44, 8.2, 1.57]
places = [[12.44, 10.9]]
[[robot]]
id = "r2"
start = [12.44, 9.2, 1.57]
places = [[14.0, 12.4]]
[[robot]]
id = "r3"
start = [17.3, 8.2, 1.57]
places = [[17.3, 12.4]]
[[event]]
at = 0.3
kill = "r2"
[[event]]
at = 0.3
close = [17.33, 9.48]
[[event]]
at = 18.0
open = [17.33, 9.48]
[[event]]
at = 0.5
jam = [27.0, 12.0]
radius = 0.5
duration = 2.0
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("kept") / "out"
    plan = swarm.plan(parse(SCENARIO, REPOSITORY / "kept.toml"), RunOptions(out, bus="memory", json=True))
    swarm.run_in_memory(plan, lambda progress: None)
    return out


def test_what_kept_nobody_is_left_in(kept: Path) -> None:
    spent = account(kept)
    assert spent.robots["r1"][Cause.BY_DEAD.value] > 10 and spent.robots["r3"][Cause.CLOSED_DOOR.value] > 10
    assert [one.robot for one in spent.blames if one.cause == Cause.BY_DEAD.value] == ["r2"]
    dead, door = omissions(kept, spent)
    assert (dead.words, len(dead.orders)) == ("r2 dead", 1)
    assert door.words == "the closed door at (17.33, 9.48)"
    assert [step for step, _ in door.orders] == [3, 180], "to open it makes no sense either"


def test_the_command_says_how_many_places_more(kept: Path) -> None:
    told = CliRunner().invoke(app, ["causes", str(kept), "--what-if", "--json"])
    assert json.loads(told.output)["what_if"] == [
        {"without": "r2 dead", "places": 2},
        {"without": "the closed door at (17.33, 9.48)", "places": 1},
    ]


def test_it_is_the_same_every_time(kept: Path) -> None:
    (dead, _) = omissions(kept, account(kept))
    assert [*what_if(kept, [dead], INSTALLED)] == [WhatIf("r2 dead", 2)]


def test_without_a_scenario_there_is_nothing_to_make_again(kept: Path, tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match=r"has no scenario\.toml, so it cannot be made again"):
        omissions(tmp_path, account(kept))
