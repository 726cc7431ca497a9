"""Tables of a scenario: set-ups made of them, and the copied text."""

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from msgspec.structs import replace

from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.installation.repository import REPOSITORY
from actors.instant import milliseconds, seconds
from actors.radio.radio_model import WifiParameters
from actors.radio.walls import WallPatch
from actors.randomness import generator
from actors.robot import assembly
from actors.robot.behaviour.ports import ExchangeSettings
from actors.robot.localisation import PRESETS
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.navigation.steering import DWA_PRESETS
from actors.robot.stack import Adaptation, Stack, stack
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.settings import loads
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.tables import Scenario, decode_swarm_file, to_toml
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
    return scenario(text).adaptation


def stacked(text: str) -> Stack:
    return stack(loads(text))


def test_every_key_of_adaptation() -> None:
    assert adapted(ADAPTATION) == Adaptation(
        settings={"lease": 2.5, "tries": 3, "fair": True, "the mode": "bold"},
        exchange=ExchangeSettings(milliseconds(500), True, 15, seconds(0), -81.5, seconds(10)),
        areas=(Area("hall", 11.5, 1.0, 13.5, 7.0),),
    )
    assert adapted("") == Adaptation()
    assert ExchangeSettings() == ExchangeSettings(seconds(1), False, 3, seconds(1), 0.0, seconds(30))


def test_the_start_of_a_behaviour() -> None:
    floor_plan = load_map(REPOSITORY / "maps" / "corridor.yaml")
    model = load_model("turtlebot2", "chapter")
    robot = assembly.RobotSetup(
        *("r1", "turtlebot2", None, (12.0, 5.0, 0.0), ()),
        epoch=0,
        first_step=0,
        seed=7,
        step_us=100_000,
        address=1,
        members=(("r1", 1), ("r2", 2)),
        behaviour="x:y",
        adaptation=adapted(ADAPTATION),
    )
    start = assembly.start(robot, model, assembly.floor(floor_plan, model, robot.stack))
    assert dict(start.settings) == {"lease": 2.5, "tries": 3, "fair": True, "the mode": "bold"}
    assert start.exchange.hop_limit == 15
    assert dict(start.members) == {"r1": 1, "r2": 2}
    place = start.floor.random_point()
    assert 11.5 <= place.x <= 13.5 and 1.0 <= place.y <= 7.0
    twin = generator(7, "behaviour", "r1", 0)
    twin.random(3)
    assert start.generator.random() == twin.random()  # the floor draws from the behaviour's own stream


def test_the_radio_setup_has_the_values_of_the_tables() -> None:
    told = resolve(scenario(AIR)).radio
    assert (told.preset, told.channel, told.walls) == ("beeclick", 15, "concrete")
    assert (told.shadowing_db, told.correlation_distance) == (4.0, 1.5)
    assert told.patches == (WallPatch("glass", (11.0, 14.0), (0.0, 7.0)),)
    assert told.wifi == (WifiParameters((15.0, 12.0), 6, 0.3),)
    assert Path(told.map).name == "corridor.yaml"
    text = to_toml(resolve(scenario(AIR)).scenario)
    assert resolve(parse(text, Path("settled.toml"))).radio == told
    wall = '[[wall]]\nmaterial = "glass"\nx = [12.0, 12.5]\ny = [5.0, 5.5]'
    with pytest.raises(AcrcError, match="where nothing is occupied; it must cover a wall"):
        resolve(scenario(wall))


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
    assert stacked('localisation.preset = "odometry"').localisation is None
    assert stacked('navigation.preset = "robust"\nlocalisation.preset = "robust"') == Stack()


def test_the_removed_preset_improved_is_reported_with_equivalent_keys() -> None:
    with pytest.raises(AcrcError, match=r'navigation.preset is "improved", which was removed') as raised:
        stacked('navigation.preset = "improved"')
    keys = re.findall(r'(\w+\.\w+ = (?:"\w+"|[\w.]+))', str(raised.value))
    found = stacked("\n".join(['navigation.preset = "chapter"', *keys]))
    assert found.navigation == NavigationParameters(reset_distance=3.0)
    assert found.planner == PlanningParameters(method="grid", factor=3.0)
    assert found.local_map == LOCAL_MAPS["disc"] and found.dwa == DWA["disc"]


STACK_FAULTS = {
    'localisation = { preset = "odometry", beams = 60 }': "localisation.beams is set, but must be absent",
    "navigation.replanning = -1": "navigation.replanning is -1, but must be a number of seconds",
    "navigation.recoveries = -1": "navigation.recoveries is -1, but must be a whole number of at least 0",
    "navigation.preset = 'chapter'\nplanner.cell = 0.1": "planner.cell is 0.1, but must be absent",
    "navigation.preset = 'chapter'\ndwa.escape = 0.1": "dwa.escape is 0.1, but must be absent",
    "dwa.granularity = 0.0001\ndwa.sim_time = 3": "dwa.sim_time is 3, but must be such that a traj",
}


@pytest.mark.parametrize("text", STACK_FAULTS)
def test_faults_of_the_stack(text: str) -> None:
    with pytest.raises(AcrcError) as raised:
        stacked(text)
    assert str(raised.value).startswith(STACK_FAULTS[text])


texts = some.text(some.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8)
finite = some.floats(allow_nan=False, allow_infinity=False)
coordinates = some.floats(-1e5, 1e5, allow_nan=False)
points = some.tuples(coordinates, coordinates)
poses = some.tuples(coordinates, coordinates, coordinates)


def maybe(value: some.SearchStrategy[Any]) -> some.SearchStrategy[Any]:
    return some.none() | value


def tables(**fields: some.SearchStrategy[Any]) -> some.SearchStrategy[dict[str, Any]]:
    """Generate a table whose optional keys may be absent."""
    filled = some.fixed_dictionaries(fields)
    return filled.map(lambda table: {name: value for name, value in table.items() if value is not None})


NAMES = ["hall", 'the "lab"', "C:\\"]
names = some.lists(some.sampled_from(NAMES), min_size=1, unique=True)
spans = some.tuples(coordinates, coordinates).map(sorted).filter(lambda span: span[0] < span[1])
scenarios = some.fixed_dictionaries(
    {
        "map": some.from_regex(r"/[a-z\"\\\x7f]{1,9}", fullmatch=True),
        "run": tables(
            duration=some.floats(1.0, 1e6),
            step_ms=some.integers(1, 10).map(lambda n: 10 * n),
            strategy=texts,
            modules=some.just("/a/b"),
        ),
        "strategy": some.dictionaries(
            some.text(some.characters(codec="utf-8"), max_size=8),
            some.booleans() | some.integers(-(2**63), 2**63 - 1) | finite | texts,
            max_size=4,
        ),
        "deeco": tables(
            publish=some.floats(0.001, 1e6),
            relay=some.booleans(),
            hop_limit=some.integers(1, 15),
            relay_below=some.floats(-90, 0),
            key=maybe(some.binary(min_size=16, max_size=16).map(bytes.hex)),
        ),
        "robots": tables(
            count=some.just(3),
            model=some.just("x"),
            sensor=maybe(texts),
            start=some.lists(poses, max_size=3),
            areas=maybe(names),
        ),
        "places": tables(preset=maybe(some.sampled_from(["areas", "golden"])), areas=maybe(names)),
        "area": some.tuples(*(tables(name=some.just(name), x=spans, y=spans) for name in NAMES)),
        "robot": some.lists(
            tables(
                id=some.sampled_from(["r1", "r2", "r3"]),
                odometry=maybe(some.just("kobuki")),
                start=maybe(poses),
                places=maybe(some.lists(points, max_size=3)),
            ),
            max_size=3,
            unique_by=lambda table: str(table["id"]),
        ),
        "event": some.lists(
            some.one_of(
                tables(at=some.floats(0.0, 0.5), obstacle=points, radius=some.floats(0.001, 10)),
                tables(at=some.floats(0.0, 0.5), close=points),
                tables(
                    at=some.floats(0.0, 0.5),
                    give=some.sampled_from(["r1", "r3"]),
                    places=some.lists(points, min_size=1, max_size=3),
                ),
            ),
            max_size=3,
        ),
    }
)


@given(scenarios)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_every_scenario_loads_as_it_was_written(content: dict[str, Any]) -> None:
    written = decode_swarm_file(Scenario, _as_lists(content))
    assert parse(to_toml(written), Path("/some.toml")) == written
    told = written.adaptation
    assert told.settings == written.strategy
    assert {name: type(value) for name, value in told.settings.items()} == {
        name: type(value) for name, value in written.strategy.items()
    }
    assert told.exchange.publish == written.deeco.publish
    assert told.exchange.relay is written.deeco.relay
    assert [area.name for area in told.areas] == NAMES


def test_the_copied_scenario_gives_the_same_run() -> None:
    first = resolve(load_scenario(None, Overrides(robots=11, seed=7)))
    written = to_toml(first.scenario)
    second = resolve(parse(written, Path("/elsewhere/scenario.toml")))
    found = asdict(second)
    assert found == asdict(first) | {name: found[name] for name in ("scenario", "grid")}
    assert second.grid.content == first.grid.content
    assert second.scenario == first.scenario
    assert to_toml(second.scenario) == written


def test_robots_get_only_the_areas_of_their_places() -> None:
    text = "[strategy]\nlease = 3\n[places]\nareas = ['hall']\n"
    text += "".join(
        f"[[area]]\nname = '{name}'\nx = [8, 12]\ny = [10.5, 13.8]\n" for name in ("yard", "hall")
    )
    settled = resolve(scenario(text))
    assert settled.adaptation == Adaptation({"lease": 3}, areas=(Area("hall", 8.0, 10.5, 12.0, 13.8),))
    assert resolve(settled.scenario).adaptation == settled.adaptation
    free = resolve(scenario(text.replace("areas = ['hall']", "preset = 'free'")))
    assert free.adaptation == Adaptation({"lease": 3})


def test_paths_are_relative_to_their_file() -> None:
    text = (
        'map = "../maps/a.yaml"\n[robots]\nmodel = "kinds/tall.toml"\n'
        '[[robot]]\nid = "r1"\nmodel = "/flat.toml"\n[[robot]]\nid = "r2"\nmodel = "omnibox"\n'
    )
    read = parse(text, Path("/a/b/some.toml"))
    assert (read.map, read.robots.model) == ("/a/maps/a.yaml", "/a/b/kinds/tall.toml")
    assert read.run.modules == "/a/b"
    assert parse('map = "m"\n[run]\nmodules = "../c"', Path("/a/b/some.toml")).run.modules == "/a/b/../c"
    assert [robot.model for robot in read.robot] == ["/flat.toml", "omnibox"]


def _as_lists(value: Any) -> Any:
    """Convert tuples to lists, as in a TOML file."""
    if isinstance(value, dict):
        return {name: _as_lists(item) for name, item in value.items()}
    return [_as_lists(item) for item in value] if isinstance(value, list | tuple) else value
