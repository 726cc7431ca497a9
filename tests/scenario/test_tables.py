"""Tables of adaptation, radio, localisation and navigation: what actors are told of them."""

import re
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import pytest

from actors import toml_file
from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.instant import milliseconds, seconds
from actors.radio.propagation.interferers import WifiParameters
from actors.radio.propagation.walls import WallPatch
from actors.randomness import generator
from actors.robot import assembly
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.ports import ExchangeSettings, Start
from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS
from actors.robot.localisation import PRESETS
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.stack import Stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import parse
from deploy.scenario.stack_tables import adaptation, stack
from deploy.scenario.tables import to_toml
from tests.navigation.course import DWA, LOCAL_MAPS
from tests.scenario.faults import scenario

ADAPTATION = """
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
AIR = """
[robots]
count = 2
[radio]
preset = "beeclick"
channel = 15
walls = "concrete"
shadowing_db = 4.0
correlation_distance = 1.5
[[wall]]
material = "glass"
x = [11.0, 14.0]
y = [0.0, 7.0]
[[wifi]]
at = [15, 12]
channel = 6
duty = 0.3
"""
STACK = """
[localisation]
preset = "robust"
max_particles = 1000
weighting = "product"

[navigation]
preset = "robust"
controller_patience = 2
mark_robots = false

[planner]
cached = 4

[local_map]
size = 3

[dwa]
sim_time = 2.5
goal_tolerance = 0.2
"""


def adapted(text: str) -> Adaptation:
    file = scenario(text)
    return adaptation(file.strategy, file.deeco, file.area)


def stacked(text: str) -> Stack:
    return stack(toml_file.loads(text))


def test_every_key_of_adaptation() -> None:
    assert adapted(ADAPTATION) == Adaptation(
        settings={"lease": 2.5, "tries": 3, "fair": True, "the mode": "bold"},
        exchange=ExchangeSettings(milliseconds(500), True, 15, seconds(0), -81.5, seconds(10)),
        areas=(Area("hall", 11.5, 1.0, 13.5, 7.0),),
    )


def test_defaults_of_adaptation() -> None:
    assert adapted("") == Adaptation()
    assert ExchangeSettings() == ExchangeSettings(seconds(1), False, 3, seconds(1), 0.0, seconds(30))


def test_the_behaviour_is_told() -> None:
    floor_plan = load_map(REPOSITORY / "maps" / "corridor.yaml")
    model = load_model("turtlebot2", "chapter")
    robot = assembly.RobotSetup(
        "r1",
        0,
        0,
        7,
        100_000,
        1,
        (12.0, 5.0, 0.0),
        (),
        "x:y",
        model="turtlebot2",
        adaptation=adapted(ADAPTATION),
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


def test_the_radio_is_told_what_the_tables_say() -> None:
    told = resolve(scenario(AIR)).radio
    assert (told.preset, told.channel, told.walls) == ("beeclick", 15, "concrete")
    assert (told.shadowing_db, told.correlation_distance) == (4.0, 1.5)
    assert told.patches == (WallPatch("glass", (11.0, 14.0), (0.0, 7.0)),)
    assert told.wifi == (WifiParameters(15.0, 12.0, 6, 0.3),)
    assert Path(told.map).name == "corridor.yaml"


def test_the_tables_read_back_from_the_text_of_a_settled_scenario() -> None:
    settled = resolve(scenario(AIR)).scenario
    text = to_toml(settled)
    assert resolve(parse(text, Path("settled.toml"))).radio == resolve(scenario(AIR)).radio


def test_a_wall_where_there_is_none_is_refused() -> None:
    with pytest.raises(AcrcError) as caught:
        resolve(scenario('[[wall]]\nmaterial = "glass"\nx = [12.0, 12.5]\ny = [5.0, 5.5]'))
    assert str(caught.value) == (
        "wall[0] spans x 12 to 12.5 and y 5 to 5.5 m, where nothing is occupied, but must hold a wall"
    )


def test_every_table_of_the_stack() -> None:
    found = stacked(STACK)
    assert found.localisation == replace(PRESETS["robust"], max_particles=1000, weighting="product")
    assert found.navigation == replace(
        NAVIGATION_PRESETS["robust"], controller_patience=seconds(2), mark_robots=False
    )
    assert found.planner == replace(PLANNER_PRESETS["robust"], cached=4)
    assert found.local_map == replace(LOCAL_MAP_PRESETS["robust"], size=3.0)
    assert found.dwa == replace(DWA_PRESETS["robust"], sim_time=2.5, goal_tolerance=0.2)


def test_a_file_that_names_no_preset_gets_robust() -> None:
    assert stacked("") == Stack()
    assert stacked('navigation.preset = "robust"\nlocalisation.preset = "robust"') == Stack()


def test_who_names_improved_is_told_the_keys_that_drive_as_it_did() -> None:
    with pytest.raises(AcrcError, match=r'navigation.preset is "improved", which was removed') as raised:
        stacked('navigation.preset = "improved"')
    keys = re.findall(r'(\w+\.\w+ = (?:"\w+"|[\w.]+))', str(raised.value))
    found = stacked("\n".join(['navigation.preset = "chapter"', *keys]))
    assert found.navigation == NavigationParameters(reset_distance=3.0)
    assert found.planner == PlanningParameters(method="grid", factor=3.0)
    assert found.local_map == LOCAL_MAPS["disc"] and found.dwa == DWA["disc"]


def test_without_localisation_the_odometry_is_trusted() -> None:
    assert stacked('localisation.preset = "odometry"').localisation is None


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[local-map]", "local-map is not known; did you mean local_map?"),
        ("localisation.particles = 7", "localisation.particles is not known; did you mean localisation.m"),
        ("localisation.beams = 60.0", "localisation.beams is 60.0, but must be a whole number"),
        ("localisation.beam_skip = 1", "localisation.beam_skip is 1, but must be true or false"),
        ("localisation.alpha1 = nan", "localisation.alpha1 is NaN, but must be a finite number"),
        (
            'localisation.weighting = "sum"',
            'localisation.weighting is "sum", but must be "cubes" or "product"',
        ),
        (
            'localisation = { preset = "odometry", beams = 60 }',
            'localisation.beams is set, but must be left out where the preset is "odometry", '
            "which has no parameters",
        ),
        ("navigation.replanning = -1", "navigation.replanning is -1, but must be a number of seconds"),
        ("navigation.recoveries = -1", "navigation.recoveries is -1, but must be at least 0"),
        (
            "navigation.preset = 'chapter'\nplanner.cell = 0.1",
            'planner.cell is 0.1, but must be left out where planner.method is "navfn", '
            "which does not use it",
        ),
        (
            "navigation.preset = 'chapter'\ndwa.escape = 0.1",
            'dwa.escape is 0.1, but must be left out where dwa.rules is "indigo", which does not use it',
        ),
        (
            "dwa.granularity = 0.0001\ndwa.sim_time = 3",
            "dwa.sim_time is 3, but must be such that a trajectory has at most 10000 points at the highest "
            "speeds",
        ),
    ],
)
def test_faults_of_the_stack(text: str, fault: str) -> None:
    with pytest.raises(AcrcError) as raised:
        stacked(text)
    assert str(raised.value).startswith(fault)
