"""Errors of a scenario file: each names the key, its value and the valid values."""

from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.scenario.faults import fault

POSES = "[x, y, heading] in m, m and rad, within ±100000"
STEP = "but must be a multiple of the 10 ms physics sub-step, from 10 to 100"
DURATION = "must be a number of seconds above 0 and at most 1000000"
WHOLE_COUNT = "must be a whole number from 1 to 500"
SETTING = (
    "but must be true, false, a whole number of 64 bits, a finite number, a string, or a list of at most"
    " 1000 of these"
)
SPAN = "but must be two numbers [from, to] in m, the first below the second"
ACTIONS = "kill, freeze, thaw, restart, move, jam, lose, obstacle, give, close, open"
AREA = '[[area]]\nname = "Office1"\nx = [11.5, 13.5]\ny = [1, 7]\n'
OFFICES = f'{AREA}[[area]]\nname = "Office2"\nx = [16.5, 18.25]\ny = [1, 7]\n'
TABLE = "but must be a table [strategy] with the strategy's settings; its name is in run.strategy"

VALUES = {
    "run.duration = nan": "run.duration is NaN, but must be a number of seconds above 0 and at most 1000000",
    "run.step_ms = 50.0": f"run.step_ms is 50.0, {STEP}",
    "robots.start = [[1, 2, -1e6]]": f"robots.start[0] is [1, 2, -1000000.0], but must be a pose {POSES}",
    "[[robot]]\nid = 'r1'\nplaces = [[1, 2], [-3e5, 2]]":
        "robot[0].places[1] is [-300000.0, 2], but must be a point [x, y] in m, within ±100000",
    "[[robot]]\nid = 'r1'\nadversary = 'jammer'":
        'robot[0].adversary is "jammer", but must be "mute", "forger", "replayer", "silencer", "flooder" or'
        ' "liar"',
    "radio.preset = 2020-01-01":
        'radio.preset is 2020-01-01, but must be the name of a radio preset, such as "chapter"',
    "[[wall]]\nmaterial = 'glass'\nx = [2, 1]\ny = [1, 2]": f"wall[0].x is [2, 1], {SPAN}",
    "[wall]\nx = 1": 'wall is {"x": 1}, but must be written as tables [[wall]]',
    "[[wifi]]\nat = [1, 2]\nchannel = 14\nduty = 0.5":
        "wifi[0].channel is 14, but must be a Wi-Fi channel, a whole number from 1 to 13",
    "strategy = 'none'": f'strategy is "none", {TABLE}',
    "strategy.lease = [[1]]": f"strategy.lease is [[1]], {SETTING}",
    'deeco.key = "00112233445566778899aabbccddeef"':
        'deeco.key is "00112233445566778899aabbccddeef", '
        "but must be a string of 32 hexadecimal digits, as of `openssl rand -hex 16`",
    "strategy.lease.long = 1": f'strategy.lease is {{"long": 1}}, {SETTING}',
    '[[area]]\nname = ""\nx = [1, 2]\ny = [1, 2]': 'area[0].name is "", but must be a name such as "hall"',
    '[[area]]\nname = "a"\nx = [1, 2]\ny = [2, 2]': f"area[0].y is [2, 2], {SPAN}",
    "robots.areas = []": 'robots.areas is [], but must be a list of names of areas, such as ["hall"]',
    f"{AREA}[places]\nareas = ['Office1', 2]":
        'places.areas[1] is 2, but must be the name of an area, such as "hall"',
    'navigation.preset = "best"': 'navigation.preset is "best", but must be "chapter" or "robust"',
    "local_map.size = 0.1": "local_map.size is 0.1, but must be 4 to 400 cells of 0.05 m",
    "dwa.sim_tme = 1": "unknown key dwa.sim_tme; did you mean dwa.sim_time?",
}  # fmt: skip
"""Keys with their own descriptions or rules; others are tested with the checker."""
KEYS = {
    "run.sed = 1": "unknown key run.sed; did you mean run.seed?",
    "[robot_s]": "unknown key robot_s; did you mean robots?",
    "xyz = 1":
        "unknown key xyz; known keys: map, strategy, deeco, localisation, navigation, planner, local_map, "
        "dwa, area, task, places, run, robots, radio, uncertainty, people, robot, event, wall, wifi",
    '[[area]]\nname = "a"\nx = [1, 2]\ny = [1, 2]\nz = 0':
        "unknown key area[0].z; known keys of area[0]: name, x, y",
}  # fmt: skip
TOGETHER = {
    '[[robot]]\nid = "r4"\n[[robot]]\nid = "r5"':
        'robot[1].id is "r5", but must be one of the robots r1 to r4',
    '[robots]\ncount = 1\n[[robot]]\nid = "r2"': 'robot[0].id is "r2", but must be the only robot, r1',
    '[[robot]]\nid = "r2"\n[[robot]]\nid = "r2"':
        'robot[1].id is a second "r2"; give each robot one table',
    '[places]\npreset = "listed"\n[[robot]]\nid = "r1"\nplaces = []':
        'places.preset is "listed", but r2 has no places; list them in its [[robot]] table',
    '[places]\npreset = "listed"\nper_robot = 3':
        'places.per_robot is 3, but must be absent with places.preset "listed"',
    f'{OFFICES}[robots]\nareas = ["Office1", "office2"]':
        'robots.areas[1] is "office2", which is not an area; did you mean "Office2"?',
    f'{OFFICES}[places]\nareas = ["Kitchen"]':
        'places.areas[0] is "Kitchen", but must be one of "Office1", "Office2"',
    f'{OFFICES}[robots]\nareas = ["Office1", "Office1"]':
        'robots.areas[1] is a second "Office1"; name each area once',
    f'{OFFICES}[places]\npreset = "free"\nareas = ["Office1"]':
        'places.areas must be absent with places.preset "free"',
    AREA + AREA: 'area[1].name is a second "Office1"; each area must have its own name',
    'robots.areas = ["Office1"]': 'robots.areas[0] is "Office1", but must be the name of an [[area]]',
    'places.preset = "areas"':
        'places.preset is "areas", but the scenario has no [[area]] table',
}  # fmt: skip
EVENTS = {
    "at = 1": f"event[0] has no action, but must have exactly one of {ACTIONS}",
    'at = 1\nkill = "r1"\nthaw = "r1"':
        f"event[0] has kill and thaw, but must have exactly one of {ACTIONS}",
    'at = 1\nmove = "r1"': "event[0].to is missing; move requires to",
    "at = 1\njam = [1, 2]\nradius = 1": "event[0].duration is missing; jam requires radius and duration",
    'at = 1\nlose = "r1"\nof = "r1"':
        'event[0].of is "r1", but must be one of the robots r1 to r4, and not r1',
    "at = 1\nobstacle = [1, 2]\nradius = 1\nduration = 2":
        "event[0].duration cannot be used with obstacle, which takes radius",
    'at = 1\ngive = "r1"\nplaces = []':
        "event[0].places is [], but must be a list of 1 to 1000 items of the task",
    'at = 1\nkill = "r9"': 'event[0].kill is "r9", but must be one of the robots r1 to r4',
    'at = 59.91\nkill = "r1"':
        "event[0].at is 59.91, but must be from 0 to 59.9 s, where the last step begins",
    'at = 1\nthaw = "r1"': "event[0] cannot thaw r1 at 1 s: it is running then; it must be frozen",
    'at = 2\nfreeze = "r1"\n[[event]]\nat = 1\nkill = "r1"':
        "event[0] cannot freeze r1 at 2 s: it is killed then; it must be running",
    'at = 1\nkill = "r1"\n[[event]]\nat = 2\nkill = "r1"':
        "event[1] cannot kill r1 at 2 s: it is killed then; it must be running or frozen",
    'at = 1.01\nrestart = "r1"\n[[event]]\nat = 1.1\nfreeze = "r1"':
        "event[1] cannot freeze r1 at 1.1 s, the step of its restart; choose a later step",
}  # fmt: skip
MINUTE = "[run]\nduration = 60.0\n[[event]]\n"


@pytest.mark.parametrize("text", [*VALUES, *KEYS, *TOGETHER])
def test_a_wrong_value_key_or_combination(text: str) -> None:
    assert fault(text) == f"some.toml: {(VALUES | KEYS | TOGETHER)[text]}"


@pytest.mark.parametrize("text", EVENTS)
def test_wrong_events(text: str) -> None:
    assert fault(MINUTE + text) == f"some.toml: {EVENTS[text]}"


def test_events_that_follow_one_another() -> None:
    lines = (
        'at = 5\nthaw = "r1"', 'at = 1\nfreeze = "r1"', 'at = 6\nkill = "r1"', 'at = 7\nrestart = "r1"',
        'at = 7.1\nfreeze = "r1"', 'at = 59.9\nrestart = "r1"',
    )  # fmt: skip
    assert fault(MINUTE + "\n[[event]]\n".join(lines)) == "nothing was wrong"


def test_a_missing_map_several_maps_and_text_that_is_not_toml() -> None:
    for head, is_wrong in (("", "missing"), ('map = ["a.yaml", "b.yaml"]', '["a.yaml", "b.yaml"]')):
        assert fault("", head=head) == (
            f"some.toml: map is {is_wrong}, but must be the path of a map's YAML file, relative to this file"
        )
    assert fault("[run", head="") == (
        "some.toml: invalid TOML: Expected ']' at the end of a table declaration (at end of document)"
    )


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (Overrides(robots="3.5"), f"--robots: 3.5; {WHOLE_COUNT}"),
        (Overrides(navigation="fast"), '--navigation: fast; must be "chapter" or "robust"'),
        (
            Overrides(duration="inf"),
            "--duration: inf; must be a number of seconds above 0 and at most 1000000",
        ),
        (Overrides(step="15"), f"--step: 15; {STEP.removeprefix('but ')}"),
        (Overrides(strategy=""), "--strategy: ''; must be the name of a strategy, such as \"none\""),
    ],
)
def test_a_wrong_option(overrides: Overrides, sentence: str) -> None:
    with pytest.raises(OptionError) as caught:
        load_scenario(None, overrides)
    assert str(caught.value) == sentence


def test_an_option_replaces_a_wrong_value_but_is_checked_with_the_rest() -> None:
    assert fault("[robots]\ncount = 0", Overrides(robots=2)) == "nothing was wrong"
    text = f'{MINUTE}at = 50\nkill = "r4"'
    assert fault(text, Overrides(duration="30")) == (
        "some.toml: event[0].at is 50, but must be from 0 to 29.9 s, where the last step begins"
    )
    assert fault(text, Overrides(robots="3")) == (
        'some.toml: event[0].kill is "r4", but must be one of the robots r1 to r3'
    )


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    binary, huge = tmp_path / "binary.toml", tmp_path / "huge.toml"
    binary.write_bytes(b"map = '\xff'")
    huge.write_bytes(b"#" * 1_000_001)
    for path, sentence in (
        (tmp_path / "none.toml", "the scenario file cannot be read: No such file or directory"),
        (tmp_path, "the scenario file cannot be read: Is a directory"),
        (binary, "byte 7 of the scenario file is not UTF-8"),
        (huge, "the scenario file is larger than 1000000 bytes"),
    ):
        with pytest.raises(AcrcError, match=f"^{path}: {sentence}$"):
            load_scenario(path)
