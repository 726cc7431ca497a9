"""What files say about the robots' adaptation, and every way in which it can be wrong."""

import tracemalloc
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import BeforeValidator, Field

from actors import table_wording, toml_file
from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.geometry import Point, Pose
from actors.instant import milliseconds, seconds
from actors.randomness import generator
from actors.robot import assembly
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.ports import ExchangeSettings, Start
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.table import FileTable, as_tuples
from deploy.scenario.adaptation_tables import AreaTable, DeecoTable, Settings, adaptation

WHOLE = """
[strategy]
lease = 2.5
tries = 3
fair = true
"the mode" = "bold"

[deeco]
publish = 0.5
relay = true
hop_limit = 15
relay_delay = 0
relay_below = -81.5
forget = 10

[[area]]
name = "hall"
x = [11.5, 13.5]
y = [1, 7]
"""
SETTING = (
    "but must be true, false, a whole number of 64 bits, a finite number, a text, or a list of at most"
    " 1000 of these"
)
INTERVAL = "but must be a number of seconds from 0.001 to 1000000"
STRENGTH = "but must be a number of dBm from -90 to 0"
SPAN = "but must be two numbers [from, to] in m, the first below the second"


class File(FileTable):
    """The tables as scenario and fleet have them."""

    strategy: Settings = Field(default_factory=dict)
    deeco: DeecoTable = DeecoTable()
    area: Annotated[tuple[AreaTable, ...], BeforeValidator(as_tuples)] = ()


def parse(text: str) -> Adaptation:
    file = table_wording.parse(text, File)
    return adaptation(file.strategy, file.deeco, file.area)


def test_everything_that_a_file_may_hold() -> None:
    assert parse(WHOLE) == Adaptation(
        settings={"lease": 2.5, "tries": 3, "fair": True, "the mode": "bold"},
        exchange=ExchangeSettings(milliseconds(500), True, 15, seconds(0), -81.5, seconds(10)),
        areas=(Area("hall", 11.5, 1.0, 13.5, 7.0),),
    )


def test_an_empty_file_says_nothing() -> None:
    assert parse("") == Adaptation()
    assert ExchangeSettings() == ExchangeSettings(seconds(1), False, 3, seconds(1), 0.0, seconds(30))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            "strategy = 3",
            "strategy is 3, but must be a table [strategy] with the strategy's settings;"
            " its name stands in run.strategy",
        ),
        ("deeco = 3", "deeco is 3, but must be a table [deeco]"),
        ("area = 3", "area is 3, but must be written as tables [[area]]"),
        ("areas = 3", "areas is not known; did you mean area?"),
        ("[strategy]\na = nan", f"strategy.a is NaN, {SETTING}"),
        ("[strategy]\na = [[1]]", f"strategy.a is [[1]], {SETTING}"),
        ("[deeco]\npublishing = 1", "deeco.publishing is not known; did you mean deeco.publish?"),
        (
            "[deeco]\nx = 1",
            "deeco.x is not known; deeco may hold publish, relay, hop_limit, relay_delay, relay_below,"
            " forget",
        ),
        ("[deeco]\npublish = 0", f"deeco.publish is 0, {INTERVAL}"),
        ("[deeco]\npublish = true", f"deeco.publish is true, {INTERVAL}"),
        ("[deeco]\nforget = inf", f"deeco.forget is Infinity, {INTERVAL}"),
        (
            "[deeco]\nrelay_delay = -0.1",
            "deeco.relay_delay is -0.1, but must be a number of seconds from 0 to 1000000",
        ),
        ("[deeco]\nrelay_below = 0.1", f"deeco.relay_below is 0.1, {STRENGTH}"),
        ("[deeco]\nrelay_below = -90.5", f"deeco.relay_below is -90.5, {STRENGTH}"),
        ("[deeco]\nrelay_below = -inf", f"deeco.relay_below is -Infinity, {STRENGTH}"),
        ("[deeco]\nrelay_below = '-80'", f'deeco.relay_below is "-80", {STRENGTH}'),
        ("[deeco]\nrelay = 1", "deeco.relay is 1, but must be true or false"),
        ("[deeco]\nhop_limit = 0", "deeco.hop_limit is 0, but must be a whole number from 1 to 15"),
        ("[deeco]\nhop_limit = true", "deeco.hop_limit is true, but must be a whole number from 1 to 15"),
        ("area = [3]", "area[0] is 3, but must be a table [[area]]"),
        (
            "[[area]]\nname = 'a'\nx = [1, 2]",
            f"area[0].y is missing, {SPAN}",
        ),
        (
            "[[area]]\nname = 1\nx = [1, 2]\ny = [1, 2]",
            'area[0].name is 1, but must be a name such as "hall"',
        ),
        ("[[area]]\nname = 'a'\nx = [2, 1]\ny = [1, 2]", f"area[0].x is [2, 1], {SPAN}"),
        ("[[area]]\nname = 'a'\nx = [1, 2]\ny = [1, true]", f"area[0].y is [1, true], {SPAN}"),
        ("[strategy]\na = 9223372036854775808", f"strategy.a is 9223372036854775808, {SETTING}"),
        (
            "[[area]]\nname = 'a'\nx = [1, 2]\ny = [1, 1e6]",
            "area[0].y is 1000000.0, but coordinates must be within ±100000 m",
        ),
        ("[strategy", "this is no TOML: Expected ']' at the end of a table declaration (at end of document)"),
    ],
)
def test_a_wrong_file_is_one_sentence(text: str, fault: str) -> None:
    with pytest.raises(AcrcError) as caught:
        parse(text)
    assert str(caught.value) == fault


@pytest.mark.parametrize("table", ["", "[deeco]\n", "[strategy]\n", "[[area]]\n"])
def test_of_many_faults_only_the_first_is_kept(table: str) -> None:
    text = table + "".join(f"k{number} = [[]]\n" for number in range(100_000))
    content = toml_file.loads(text)
    tracemalloc.start()
    with pytest.raises(AcrcError, match=r"k0|area"):
        table_wording.checked(content, File)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_the_behaviour_is_told() -> None:
    floor_plan = load_map(Path(__file__).parents[2] / "maps" / "corridor.yaml")
    model = load_model("turtlebot2", "chapter")
    robot = assembly.RobotSetup(
        "r1", 0, 0, 7, 100_000, 1, (12.0, 5.0, 0.0), (), "x:y", model="turtlebot2", adaptation=parse(WHOLE)
    )
    start = assembly.start(robot, model, assembly.floor(floor_plan, model, robot.stack))
    assert dict(start.settings) == {"lease": 2.5, "tries": 3, "fair": True, "the mode": "bold"}
    assert start.exchange.hop_limit == 15
    place = start.floor.random_place()
    assert 11.5 <= place.x <= 13.5 and 1.0 <= place.y <= 7.0
    twin = generator(7, "behaviour", "r1", 0)
    twin.random(3)
    assert start.generator.random() == twin.random()  # the floor draws from the behaviour's own stream


def test_what_a_behaviour_is_told_cannot_be_changed() -> None:
    start = Start("r1", 1, 0, Pose(0.0, 0.0, 0.0), (Point(1.0, 2.0),), generator(1, "behaviour", "r1"))
    assert (dict(start.settings), start.exchange) == ({}, ExchangeSettings())
    with pytest.raises(TypeError):
        start.settings["lease"] = 1  # type: ignore[index]
    with pytest.raises(FrozenInstanceError):
        start.exchange.relay = True  # type: ignore[misc]
    with pytest.raises(LookupError, match="without a floor plan"):
        start.floor.random_place()
