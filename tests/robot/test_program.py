"""The robot's command line."""

import json
import math
from pathlib import Path

import pytest

from actors.geometry import Point, Pose
from actors.messages import READY, SENSES, Ready
from actors.robot.assembly import kernels
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.modules import FOLDERS, look_in
from actors.robot.behaviour.places import load_places
from actors.robot.program import build, parse, part
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.fingerprint import combined

POINT = "but must be a point [x, y] in m"
MAPS = Path(__file__).parents[2] / "maps"


@pytest.fixture
def argv(tmp_path: Path) -> dict[str, str]:
    places = tmp_path / "places.toml"
    places.write_text("# two\nplaces = [\n    [12.5, 6.0],\n    [9, 12.25],\n]\n")
    return {
        "--id": "r1",
        "--epoch": "2",
        "--first-step": "40",
        "--seed": "7",
        "--step-us": "50000",
        "--address": "3",
        "--map": str(MAPS / "corridor.yaml"),
        "--model": "turtlebot2",
        "--sensor": "kinect",
        "--start": "12.0,5.0,4.0",
        "--places": str(places),
        "--behaviour": "tests.robot.behaviours:keeper",
        "--router": "tcp/127.0.0.1:1",
        "--credentials": str(tmp_path / "credentials"),
        "--record": str(tmp_path / "r1.mcap"),
    }


def flat(argv: dict[str, str]) -> list[str]:
    return [f"{name}={value}" for name, value in argv.items()]


def test_every_option_is_read(argv: dict[str, str], tmp_path: Path) -> None:
    options = parse(flat(argv))
    setup = options.setup
    assert (setup.id, setup.epoch, setup.first_step, setup.seed) == ("r1", 2, 40, 7)
    assert (setup.step_us, setup.address, setup.behaviour) == (50_000, 3, "tests.robot.behaviours:keeper")
    assert setup.start == pytest.approx(Pose(12.0, 5.0, 4.0 - math.tau))
    assert setup.places == (Point(12.5, 6.0), Point(9.0, 12.25))
    assert (options.model, options.sensor) == ("turtlebot2", "kinect")
    assert options.map == MAPS / "corridor.yaml"
    assert options.client.record == tmp_path / "r1.mcap"
    assert not options.isolate
    assert setup.adaptation == Adaptation()


def test_the_adaptation_is_read_from_its_file(argv: dict[str, str], tmp_path: Path) -> None:
    file = tmp_path / "adaptation.toml"
    file.write_text("[strategy]\nlease = 3\n")
    robot = part(flat(argv | {"--adaptation": str(file)}))
    assert json.loads(robot.run.scenario)["adaptation"]["settings"] == {"lease": 3}


def test_the_folder_that_is_named_first_goes_first(argv: dict[str, str]) -> None:
    look_in(parse([*flat(argv), "--path", "/one", "--path", "/two"]).path)
    assert FOLDERS.folders == (Path("/one"), Path("/two"))


def test_the_core_begins_with_the_step_and_listens_to_its_own_keys(argv: dict[str, str]) -> None:
    options = parse(flat(argv))
    core = build(options)
    assert core.step == 40
    assert core.missing({}) == (at(SENSES, "r1"),)
    assert options.setup.id == "r1"


def test_the_part_says_ready_with_its_kernels_and_records_what_it_was_started_with(
    argv: dict[str, str],
) -> None:
    robot = part(flat(argv))
    assert robot.ready == (at(READY, "r1"), Ready(40, "r1", 2, combined(kernels())))
    assert [address.key for address in robot.listens] == ["swarm/down/r1/senses", "swarm/down/r1/received"]
    assert (robot.run.actor, robot.run.seed, robot.run.step_us) == ("r1", 7, 50_000)
    assert robot.run.argv == tuple(flat(argv))
    ours = [name for name in sorted(robot.run.kernels) if not name.startswith("actors.portable.")]
    assert ours == [
        "actors.floor.distance",
        "actors.floor.flood",
        "actors.robot.localisation.beams",
        "actors.robot.localisation.confidence",
        "actors.robot.localisation.evidence",
        "actors.robot.localisation.histogram",
        "actors.robot.localisation.line_of_sight",
        "actors.robot.localisation.measurement",
        "actors.robot.localisation.motion",
        "actors.robot.localisation.resampling",
        "actors.robot.navigation.cell_distance",
        "actors.robot.navigation.dwa",
        "actors.robot.navigation.inflation",
        "actors.robot.navigation.map_grid",
        "actors.robot.navigation.potential",
        "actors.robot.navigation.ray_tracing",
    ]


@pytest.mark.parametrize(
    ("option", "value", "sentence"),
    [
        ("--id", "r/1", "--id is 'r/1'; it should be 1 to 32 letters, digits, '-' or '_'"),
        ("--id", "*", "--id is '*'; it should be 1 to 32 letters, digits, '-' or '_'"),
        ("--seed", "-1", "--seed is -1; it should be at least 0"),
        ("--epoch", "-1", "--epoch is -1; it should be at least 0"),
        ("--first-step", "-1", "--first-step is -1; it should be at least 0"),
        ("--step-us", "0", "--step-us is 0; it should be at least 1"),
        ("--address", "-1", "--address is -1; it should be at least 0"),
        ("--start", "1,2", "--start is '1,2'; it should be three numbers x,y,heading in m and rad"),
        ("--start", "1,2,nan", "--start is '1,2,nan'; it should be three numbers x,y,heading in m and rad"),
        ("--start", "a,2,3", "--start is 'a,2,3'; it should be three numbers x,y,heading in m and rad"),
        ("--seed", "x", "python -m actors.robot: argument --seed: invalid int value: 'x'"),
    ],
)
def test_wrong_values_are_one_sentence(argv: dict[str, str], option: str, value: str, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        parse(flat(argv | {option: value}))
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("places = [[1, 2, 3]]", f": places[0] is [1, 2, 3], {POINT}"),
        ("places = [[1, 2], [1, inf]]", f": places[1] is [1, Infinity], {POINT}"),
        ("places = [[1, true]]", f": places[0] is [1, true], {POINT}"),
        ("places = [3]", f": places[0] is 3, {POINT}"),
        ("places = 3", ": places is 3, but must be a list of points [x, y] in m"),
        ("", ": places is missing, but must be a list of points [x, y] in m"),
        ("a = 1", ": places is missing, but must be a list of points [x, y] in m"),
        ("places = [", ": this is no TOML: Invalid value (at end of document)"),
        ("#" * 1_000_001, ": the places file may have at most 1000000 bytes, but has more"),
    ],
)
def test_wrong_files_of_places_are_one_sentence(tmp_path: Path, text: str, fault: str) -> None:
    path = tmp_path / "places.toml"
    path.write_text(text)
    with pytest.raises(AcrcError) as caught:
        load_places(path)
    assert str(caught.value) == f"{path}{fault}"


def test_a_missing_file_of_places_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(AcrcError) as caught:
        load_places(tmp_path / "none.toml")
    assert (
        str(caught.value)
        == f"{tmp_path}/none.toml: the places file cannot be read: No such file or directory"
    )
