"""Every fault of a scenario file, and the one sentence that says it."""

from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.radio.propagation.walls import MATERIALS
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.scenario.faults import fault

METRES = "but must be a number of metres from 0 to 0.5"
POSES = "[x, y, heading] in m, m and rad"
DURATION = "but must be a number of seconds above 0, at most 1000000"
INSTANT = "but must be a number of seconds from 0 to below the duration"
SETTING = (
    "but must be true, false, a whole number of 64 bits, a finite number, a text, or a list of at most"
    " 1000 of these"
)
WITHIN = "but coordinates must be within ±100000"
INTERVAL = "but must be a number of seconds from 0.001 to 1000000"
CHANNEL = "but must be an IEEE 802.15.4 channel, a whole number from 11 to 26"
MATERIAL = "but must be a material: " + ", ".join(f'"{name}"' for name in MATERIALS)
ACTIONS = "kill, freeze, thaw, restart, move, jam, lose, obstacle, give, close, open"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[run]\nduration = 0", f"run.duration is 0, {DURATION}"),
        ("[run]\nduration = nan", f"run.duration is NaN, {DURATION}"),
        ("[run]\nduration = true", f"run.duration is true, {DURATION}"),
        (
            "[run]\nstep_ms = 15",
            "run.step_ms is 15, but must be a multiple of the 10 ms physics sub-step, from 10 to 100",
        ),
        (
            "[run]\nstep_ms = 50.0",
            "run.step_ms is 50.0, but must be a multiple of the 10 ms physics sub-step, from 10 to 100",
        ),
        ("[run]\nseed = -1", "run.seed is -1, but must be a whole number from 0 to 9223372036854775807"),
        ("[run]\nstrategy = 3", 'run.strategy is 3, but must be the name of a strategy, such as "none"'),
        ("[robots]\ncount = 0", "robots.count is 0, but must be a whole number from 1 to 500"),
        ('[robots]\nodometry = "gps"', 'robots.odometry is "gps", but must be "exact", "stage" or "kobuki"'),
        ("[robots]\nstart = 3", f"robots.start is 3, but must be a list of poses {POSES}, at most 500"),
        ("[robots]\nstart = [[1, 2, 3], [1, 2]]", f"robots.start[1] is [1, 2], but must be a pose {POSES}"),
        (
            '[robots]\nstart = [[1, 2, 3], [1, "two", 3]]',
            f'robots.start[1] is [1, "two", 3], but must be a pose {POSES}',
        ),
        ("[robots]\nstart = [[1, 388097.5, 3]]", f"robots.start[0] y is 388097.5, {WITHIN} m"),
        ("[robots]\nstart = [[1, 2, -1e6]]", f"robots.start[0] heading is -1000000.0, {WITHIN} rad"),
        ("[robots]\nstart = [[1, 2e5]]", f"robots.start[0] y is 200000.0, {WITHIN} m"),
        ("[[robot]]\nid = 'r1'\nstart = [388097, 2, 3]", f"robot[0].start x is 388097, {WITHIN} m"),
        (
            "[[robot]]\nid = 'r1'\nplaces = [[1, 2], [-3e5, 2]]",
            f"robot[0].places[1] x is -300000.0, {WITHIN} m",
        ),
        ("[[wifi]]\nat = [1e6, 2]\nchannel = 1\nduty = 0.5", f"wifi[0].at x is 1000000.0, {WITHIN} m"),
        ("[[wall]]\nmaterial = 'brick'\nx = [1, 1e6]\ny = [1, 2]", f"wall[0].x is 1000000.0, {WITHIN} m"),
        ("[[event]]\nat = 1\nmove = 'r1'\nto = [1, 1e6, 0]", f"event[0].to y is 1000000.0, {WITHIN} m"),
        (
            "[[event]]\nat = 1\nobstacle = [1, 1e6]\nradius = 1",
            f"event[0].obstacle y is 1000000.0, {WITHIN} m",
        ),
        ('[places]\npreset = "x"', 'places.preset is "x", but must be "golden", "areas", "free" or "listed"'),
        (
            "[radio]\npreset = 2020-01-01",
            'radio.preset is 2020-01-01, but must be the name of a radio preset, such as "chapter"',
        ),
        ("[radio]\nchannel = 27", f"radio.channel is 27, {CHANNEL}"),
        ("[radio]\nwalls = 'cheese'", f'radio.walls is "cheese", {MATERIAL}'),
        ("[radio]\nwalls = 3", f"radio.walls is 3, {MATERIAL}"),
        ("[radio]\nshadowing_db = -1", "radio.shadowing_db is -1, but must be a number of dB from 0 to 30"),
        (
            "[radio]\ncorrelation_distance = 0",
            "radio.correlation_distance is 0, but must be a number of metres from 0.1 to 1000",
        ),
        ("[uncertainty]\nmap_error = -1", f"uncertainty.map_error is -1, {METRES}"),
        ("[uncertainty]\nglass = 2", "uncertainty.glass is 2, but must be a share from 0 to 1"),
        (
            "[uncertainty]\nfurniture = 1.5",
            "uncertainty.furniture is 1.5, but must be a whole number from 0 to 1000",
        ),
        ("[uncertainty]\ndrift = inf", "uncertainty.drift is Infinity, but must be a number from 0 to 1000"),
        ("[[wall]]\nx = [1, 2]\ny = [1, 2]", f"wall[0].material is missing, {MATERIAL}"),
        (
            "[[wall]]\nmaterial = 'glass'\nx = [2, 1]\ny = [1, 2]",
            "wall[0].x is [2, 1], but must be two numbers [from, to] in m, the first below the second",
        ),
        ("[wall]\nx = 1", 'wall is {"x": 1}, but must be written as tables [[wall]]'),
        (
            "[[wifi]]\nat = [1, 2]\nchannel = 14\nduty = 0.5",
            "wifi[0].channel is 14, but must be a Wi-Fi channel, a whole number from 1 to 13",
        ),
        (
            "[[wifi]]\nat = [1, 2]\nchannel = 1\nduty = 1",
            "wifi[0].duty is 1, but must be a number above 0 and below 1",
        ),
        ("[[wifi]]\nat = 1\nchannel = 1\nduty = 0.1", "wifi[0].at is 1, but must be a point [x, y] in m"),
        (
            "[[wifi]]\nat = [1, 2]\nchannel = 1\nduty = 0.1\npower_dbm = 99",
            "wifi[0].power_dbm is 99, but must be a number of dBm from -60 to 30",
        ),
        (
            "[[robot]]\nmodel = 'turtlebot2'",
            'robot[0].id is missing, but must be the id of a robot, such as "r2"',
        ),
        ('[[robot]]\nid = "x"', 'robot[0].id is "x", but must be the id of a robot, such as "r2"'),
        (
            '[[robot]]\nid = "r1"\n[[robot]]\nid = "r2"\nplaces = [[1, 2], [3]]',
            "robot[1].places[1] is [3], but must be a point [x, y] in m",
        ),
        ("[[event]]\nkill = 'r1'", f"event[0].at is missing, {INSTANT}"),
        ("[[event]]\nat = -1\nkill = 'r1'", f"event[0].at is -1, {INSTANT}"),
        ("[[event]]\nat = 1\njam = [1]", "event[0].jam is [1], but must be a point [x, y] in m"),
        (
            "[[event]]\nat = 1\njam = [1, 2]\nradius = 0\nduration = 1",
            "event[0].radius is 0, but must be a number of metres above 0, at most 1000",
        ),
        ("[event]\nat = 1", 'event is {"at": 1}, but must be written as tables [[event]]'),
        ("event = [3]", "event[0] is 3, but must be a table [[event]]"),
        ("run = 3", "run is 3, but must be a table [run]"),
        (
            "[run]\nmodules = 3",
            "run.modules is 3, but must be the path of a folder, relative to the scenario file",
        ),
        ("[strategy]\nlease = [[1]]", f"strategy.lease is [[1]], {SETTING}"),
        ("[strategy]\nlease = inf", f"strategy.lease is Infinity, {SETTING}"),
        ("[strategy]\nlease = 1979-05-27", f"strategy.lease is 1979-05-27, {SETTING}"),
        ("[strategy.lease]\nlong = 1", f'strategy.lease is {{"long": 1}}, {SETTING}'),
        ("[strategy]\nlease = 9223372036854775808", f"strategy.lease is 9223372036854775808, {SETTING}"),
        (
            "strategy = 'none'",
            'strategy is "none", but must be a table [strategy] with the strategy\'s settings;'
            " its name stands in run.strategy",
        ),
        ("deeco = 3", "deeco is 3, but must be a table [deeco]"),
        ("[deeco]\npublish = 0", f"deeco.publish is 0, {INTERVAL}"),
        ("[deeco]\nforget = 1000001", f"deeco.forget is 1000001, {INTERVAL}"),
        ("[deeco]\nrelay = 1", "deeco.relay is 1, but must be true or false"),
        ("[deeco]\nhop_limit = 16", "deeco.hop_limit is 16, but must be a whole number from 1 to 15"),
        ("[deeco]\nhop_limit = true", "deeco.hop_limit is true, but must be a whole number from 1 to 15"),
        (
            "[deeco]\nrelay_delay = -1",
            "deeco.relay_delay is -1, but must be a number of seconds from 0 to 1000000",
        ),
        (
            "[deeco]\nrelay_below = -91",
            "deeco.relay_below is -91, but must be a number of dBm from -90 to 0",
        ),
    ],
)
def test_a_wrong_value(text: str, sentence: str) -> None:
    assert fault(text) == f"some.toml: {sentence}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[run]\nsed = 1", "run.sed is not known; did you mean run.seed?"),
        ("[robot_s]", "robot_s is not known; did you mean robots?"),
        (
            "[run]\nxyz = 1",
            "run.xyz is not known; run may hold duration, step_ms, seed, key, strategy, modules",
        ),
        (
            "xyz = 1",
            "xyz is not known; known are map, run, strategy, deeco,"
            " localisation, navigation, planner, local_map, dwa,"
            " robots, places, radio, uncertainty, area, robot, event, wall, wifi",
        ),
        ("[deeco]\nrelays = true", "deeco.relays is not known; did you mean deeco.relay?"),
        ('[[event]]\nat = 1\nkil = "r1"', "event[0].kil is not known; did you mean event[0].kill?"),
    ],
)
def test_an_unknown_key(text: str, sentence: str) -> None:
    assert fault(text) == f"some.toml: {sentence}"


def test_a_missing_map_several_maps_and_text_that_is_no_toml() -> None:
    for head, is_wrong in (("", "missing"), ('map = ["a.yaml", "b.yaml"]', '["a.yaml", "b.yaml"]')):
        assert fault("", head=head) == (
            f"some.toml: map is {is_wrong}, but must be the path of a map's YAML file,"
            " relative to the scenario file"
        )
    assert fault("[run", head="") == (
        "some.toml: this is no TOML: Expected ']' at the end of a table declaration (at end of document)"
    )
    assert fault("x = " + "[" * 5000, head="").startswith("some.toml: this is no TOML: ")
    assert fault("x = " + "1" * 5000, head="").startswith("some.toml: this is no TOML: ")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[[robot]]\nid = "r4"\n[[robot]]\nid = "r5"',
            'robot[1].id is "r5", but must be one of the robots r1 to r4',
        ),
        (
            '[robots]\ncount = 1\n[[robot]]\nid = "r2"',
            'robot[0].id is "r2", but must be the only robot, r1',
        ),
        (
            '[[robot]]\nid = "r2"\n[[robot]]\nid = "r2"',
            'robot[1].id is "r2" once more, but each robot must have one table only',
        ),
        (
            '[places]\npreset = "listed"\n[[robot]]\nid = "r1"\nplaces = []',
            'places.preset is "listed", but r2 lists none: a [[robot]] table must hold its places',
        ),
        (
            '[places]\npreset = "listed"\nper_robot = 3',
            'places.per_robot is 3, but must be left out where places.preset is "listed"',
        ),
    ],
)
def test_tables_that_do_not_go_together(text: str, sentence: str) -> None:
    assert fault(text) == f"some.toml: {sentence}"


def events(*lines: str) -> str:
    return "[run]\nduration = 60.0\n" + "".join(f"[[event]]\n{line}\n" for line in lines)


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (
            ["at = 1"],
            f"event[0] has no action, but must have exactly one of {ACTIONS}",
        ),
        (
            ['at = 1\nkill = "r1"\nthaw = "r1"'],
            f"event[0] has kill and thaw, but must have exactly one of {ACTIONS}",
        ),
        (['at = 1\nmove = "r1"'], "event[0].to is missing, but move needs to"),
        (
            ["at = 1\njam = [1, 2]\nradius = 1"],
            "event[0].duration is missing, but jam needs radius and duration",
        ),
        (['at = 1\nlose = "r1"'], "event[0].of is missing, but lose needs of"),
        (
            ['at = 1\nlose = "r1"\nof = "r1"'],
            'event[0].of is "r1", but must be one of the robots r1 to r4, and not r1',
        ),
        (
            ["at = 1\nobstacle = [1, 2]\nradius = 1\nduration = 2"],
            "event[0].duration does not belong to obstacle, which needs radius beside it",
        ),
        (
            ['at = 1\nkill = "r1"\nradius = 1'],
            "event[0].radius does not belong to kill, which needs nothing beside it",
        ),
        (['at = 1\ngive = "r1"'], "event[0].places is missing, but give needs places"),
        (
            ['at = 1\ngive = "r9"\nplaces = [[1, 2]]'],
            'event[0].give is "r9", but must be one of the robots r1 to r4',
        ),
        (
            ['at = 1\ngive = "r1"\nplaces = []'],
            "event[0].places is [], but must be a list of 1 to 1000 points [x, y] in m",
        ),
        (['at = 1\nkill = "r9"'], 'event[0].kill is "r9", but must be one of the robots r1 to r4'),
        (
            ['at = 60\nkill = "r1"'],
            "event[0].at is 60, but must be from 0 to 59.9 s, where the last step begins",
        ),
        (
            ['at = 59.91\nkill = "r1"'],
            "event[0].at is 59.91, but must be from 0 to 59.9 s, where the last step begins",
        ),
        (['at = 1\nthaw = "r1"'], "event[0] would thaw r1 at 1 s, but it is running then; it must be frozen"),
        (
            ['at = 2\nfreeze = "r1"', 'at = 1\nkill = "r1"'],
            "event[0] would freeze r1 at 2 s, but it is killed then; it must be running",
        ),
        (
            ['at = 1\nkill = "r1"', 'at = 2\nkill = "r1"'],
            "event[1] would kill r1 at 2 s, but it is killed then; it must be running or frozen",
        ),
        (
            ['at = 1.01\nrestart = "r1"', 'at = 1.1\nfreeze = "r1"'],
            "event[1] would freeze r1 at 1.1 s, in the step in which it restarts;"
            " that must come a step later",
        ),
    ],
)
def test_events_that_make_no_sense(lines: list[str], sentence: str) -> None:
    assert fault(events(*lines)) == f"some.toml: {sentence}"


def test_events_that_follow_one_another() -> None:
    lines = [
        'at = 5\nthaw = "r1"', 'at = 1\nfreeze = "r1"', 'at = 6\nkill = "r1"', 'at = 7\nrestart = "r1"',
        'at = 7.1\nfreeze = "r1"', 'at = 59.9\nrestart = "r1"',
    ]  # fmt: skip
    assert fault(events(*lines)) == "nothing was wrong"


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (Overrides(robots="four"), "--robots: four; must be a whole number from 1 to 500"),
        (Overrides(robots=0), "--robots: 0; must be a whole number from 1 to 500"),
        (Overrides(robots="3.5"), "--robots: 3.5; must be a whole number from 1 to 500"),
        (Overrides(navigation="fast"), '--navigation: fast; must be "chapter" or "robust"'),
        (Overrides(seed="-1"), "--seed: -1; must be a whole number from 0 to 9223372036854775807"),
        (Overrides(duration="inf"), "--duration: inf; must be a number of seconds above 0, at most 1000000"),
        (
            Overrides(step="15"),
            "--step: 15; must be a multiple of the 10 ms physics sub-step, from 10 to 100",
        ),
        (Overrides(strategy=""), "--strategy: ''; must be the name of a strategy, such as \"none\""),
    ],
)
def test_a_wrong_option(overrides: Overrides, sentence: str) -> None:
    with pytest.raises(OptionError) as caught:
        load_scenario(None, overrides)
    assert str(caught.value) == sentence


def test_an_option_heals_the_file_but_not_what_hangs_on_it() -> None:
    assert fault("[robots]\ncount = 0", Overrides(robots=2)) == "nothing was wrong"
    text = events('at = 50\nkill = "r4"')
    assert fault(text, Overrides(duration="30")) == (
        "some.toml: event[0].at is 50, but must be from 0 to 29.9 s, where the last step begins"
    )
    assert fault(text, Overrides(robots="3")) == (
        'some.toml: event[0].kill is "r4", but must be one of the robots r1 to r3'
    )


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    def refusal(path: Path) -> str:
        with pytest.raises(AcrcError) as caught:
            load_scenario(path)
        return str(caught.value)

    none, binary, huge = tmp_path / "none.toml", tmp_path / "binary.toml", tmp_path / "huge.toml"
    binary.write_bytes(b"map = '\xff'")
    huge.write_bytes(b"#" * 1_000_001)
    assert refusal(none) == f"{none}: the scenario file cannot be read: No such file or directory"
    assert refusal(tmp_path) == f"{tmp_path}: the scenario file cannot be read: Is a directory"
    assert refusal(binary) == f"{binary}: byte 7 of the scenario file is not UTF-8"
    assert refusal(huge) == f"{huge}: the scenario file may have at most 1000000 bytes, but has more"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("localisation = 3", "localisation is 3, but must be a table of a preset and of parameters"),
        ("[localisation]\nbeams = []", "localisation.beams is [], but must be a whole number of 64 bits"),
        (
            '[navigation]\npreset = "best"',
            'navigation.preset is "best", but must be "chapter" or "robust"',
        ),
        ("[dwa]\nsim_tim = 2", "dwa.sim_tim is not known; did you mean dwa.sim_time?"),
        ("[dwa]\nsim_time = 0", "dwa.sim_time is 0, but must be above 0"),
        ("[local_map]\nsize = 0.1", "local_map.size is 0.1, but must be 4 to 400 cells of 0.05 m"),
        ("[planner]\ncached = 1.5", "planner.cached is 1.5, but must be a whole number of 64 bits"),
    ],
)
def test_wrong_localisation_and_navigation(text: str, sentence: str) -> None:
    assert fault(text) == f"some.toml: {sentence}"
