"""How a robot localises and navigates: presets, parameters, all ways in which the tables can be wrong."""

import re
from dataclasses import replace

import pytest

from actors import toml_file
from actors.instant import seconds
from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS
from actors.robot.localisation import PRESETS
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.stack import Stack
from actors.runtime.errors import AcrcError
from deploy.scenario.stack_tables import stack
from tests.navigation.course import DWA, LOCAL_MAPS

WHOLE = """
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


def parse(text: str) -> Stack:
    return stack(toml_file.loads(text))


def test_everything_that_a_file_may_hold() -> None:
    found = parse(WHOLE)
    assert found.localisation == replace(PRESETS["robust"], max_particles=1000, weighting="product")
    assert found.navigation == replace(
        NAVIGATION_PRESETS["robust"], controller_patience=seconds(2), mark_robots=False
    )
    assert found.planner == replace(PLANNER_PRESETS["robust"], cached=4)
    assert found.local_map == replace(LOCAL_MAP_PRESETS["robust"], size=3.0)
    assert found.dwa == replace(DWA_PRESETS["robust"], sim_time=2.5, goal_tolerance=0.2)


def test_a_file_that_names_no_preset_gets_robust() -> None:
    assert parse("") == Stack()
    assert parse('navigation.preset = "robust"\nlocalisation.preset = "robust"') == Stack()


def test_who_names_improved_is_told_the_keys_that_drive_as_it_did() -> None:
    with pytest.raises(AcrcError, match=r'navigation.preset is "improved", which was removed') as raised:
        parse('navigation.preset = "improved"')
    keys = re.findall(r'(\w+\.\w+ = (?:"\w+"|[\w.]+))', str(raised.value))
    found = parse("\n".join(['navigation.preset = "chapter"', *keys]))
    assert found.navigation == NavigationParameters(reset_distance=3.0)
    assert found.planner == PlanningParameters(method="grid", factor=3.0)
    assert found.local_map == LOCAL_MAPS["disc"] and found.dwa == DWA["disc"]


def test_without_localisation_the_odometry_is_trusted() -> None:
    assert parse('localisation.preset = "odometry"').localisation is None


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("dwa = 3", "dwa is 3, but must be a table [dwa]"),
        ("[driver]", "driver is not known; known are localisation, navigation, planner, local_map, dwa"),
        ("[local-map]", "local-map is not known; did you mean local_map?"),
        (
            'localisation.preset = "best"',
            'localisation.preset is "best", but must be "chapter", "robust" or "odometry"',
        ),
        (
            "navigation.preset = 1",
            'navigation.preset is 1, but must be "chapter" or "robust"',
        ),
        ("localisation.particles = 7", None),
        ("localisation.beams = 60.0", "localisation.beams is 60.0, but must be a whole number"),
        ("localisation.beam_skip = 1", "localisation.beam_skip is 1, but must be true or false"),
        ("localisation.alpha1 = nan", "localisation.alpha1 is NaN, but must be a finite number"),
        ("localisation.alpha1 = true", "localisation.alpha1 is true, but must be a finite number"),
        (
            'localisation.weighting = "sum"',
            'localisation.weighting is "sum", but must be "cubes" or "product"',
        ),
        ("localisation.beams = 0", "localisation.beams is 0, but must be at least 1"),
        (
            'localisation = { preset = "odometry", beams = 60 }',
            'localisation.beams is set, but must be left out where the preset is "odometry", '
            "which has no parameters",
        ),
        ("navigation.tolerance = 0.15", "navigation.tolerance is not known"),
        ("navigation.retreat = 0", "navigation.retreat is 0, but must be above 0"),
        ("navigation.replanning = -1", "navigation.replanning is -1, but must be a number of seconds"),
        ("navigation.recoveries = -1", "navigation.recoveries is -1, but must be at least 0"),
        ("planner.cached = 0", "planner.cached is 0, but must be at least 1"),
        ("planner.cell = 0", "planner.cell is 0, but must be above 0"),
        (
            "navigation.preset = 'chapter'\nplanner.cell = 0.1",
            'planner.cell is 0.1, but must be left out where planner.method is "navfn", '
            "which does not use it",
        ),
        ('planner.method = "a*"', 'planner.method is "a*", but must be "navfn" or "grid"'),
        ("local_map.cell = 0", "local_map.cell is 0, but must be above 0"),
        ("dwa.sim_time = 0", "dwa.sim_time is 0, but must be above 0"),
        (
            "navigation.preset = 'chapter'\ndwa.escape = 0.1",
            'dwa.escape is 0.1, but must be left out where dwa.rules is "indigo", which does not use it',
        ),
        ('dwa.rules = "mine"', 'dwa.rules is "mine", but must be "indigo" or "disc"'),
        ('local_map.body = "square"', 'local_map.body is "square", but must be "polygon" or "disc"'),
        (
            "dwa.granularity = 0.0001\ndwa.sim_time = 3",
            "dwa.sim_time is 3, but must be such that a trajectory has at most 10000 points at the highest "
            "speeds",
        ),
        ("dwa.goal_tolerance = 0", "dwa.goal_tolerance is 0, but must be above 0"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text: str, fault: str | None) -> None:
    with pytest.raises(AcrcError) as raised:
        parse(text)
    sentence = str(raised.value)
    assert sentence.startswith(fault or "localisation.particles is not known; did you mean localisation.m")
    assert "\n" not in sentence
