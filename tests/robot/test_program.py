"""The robot's set-up, as its process reads it."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.floor.placement import Area
from actors.geometry import Point, Pose
from actors.instant import seconds
from actors.messages import READY, SENSES, Ready
from actors.robot import __main__ as robot_program
from actors.robot.assembly import RobotSetup, kernels
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.modules import FOLDERS
from actors.robot.behaviour.ports import ExchangeSettings
from actors.robot.localisation import PRESETS
from actors.robot.program import RobotProcess, RobotProgram, build, load_setup, part
from actors.robot.stack import Stack
from actors.runtime.core import at, to
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.resource_limits import ProcessLimits
from actors.runtime.process_setup import SETUP, ActorSetup, setup_bytes
from actors.runtime.processor import combined

MAPS = Path(__file__).parents[2] / "maps"
ROBOT = RobotSetup(
    id="r1",
    epoch=2,
    first_step=40,
    seed=7,
    step_us=50_000,
    address=3,
    start=(12.0, 5.0, 4.0),
    places=(Point(12.5, 6.0), Point(9.0, 12.25)),
    behaviour="tests.robot.behaviours:keeper",
    model="turtlebot2",
    sensor="kinect",
    map=str(MAPS / "corridor.yaml"),
)
PLACE = RobotProcess(record="r1.2.mcap", router="router.sock", credentials="credentials", commit="abc")
AN_ID = r", but must be a text of the form '\\A[A-Za-z0-9_-]{1,32}\\Z'"


def test_all_that_is_told_reads_back_as_it_was_written(tmp_path: Path) -> None:
    exchange = ExchangeSettings(publish=seconds(0.5), relay=True)
    adaptation = Adaptation(
        {"lease": 3, "reach": 0.5, "fair": True, "mode": "bold", "gains": (1, 2.5)},
        exchange,
        (Area("hall", 0.0, 0.0, 1.0, 2.0),),
    )
    stack = Stack(localisation=PRESETS["robust"])
    told: RobotProgram = ActorSetup(
        msgspec.structs.replace(ROBOT, adaptation=adaptation, stack=stack, doubt=0.3),
        msgspec.structs.replace(PLACE, code=("/code/1",), limits=ProcessLimits()),
    )
    (tmp_path / SETUP).write_bytes(setup_bytes(told))
    assert load_setup(tmp_path / SETUP) == told


def test_it_starts_with_a_heading_within_a_turn() -> None:
    assert ROBOT.pose == pytest.approx(Pose(12.0, 5.0, 4.0 - math.tau))


def test_the_folder_that_is_named_first_goes_first(tmp_path: Path) -> None:
    part(ActorSetup(ROBOT, msgspec.structs.replace(PLACE, code=("/one", "two"))), tmp_path)
    assert FOLDERS.folders == (Path("/one"), tmp_path / "two")
    part(ActorSetup(ROBOT, PLACE), tmp_path)


def test_the_core_begins_with_the_step_and_listens_to_its_own_keys(tmp_path: Path) -> None:
    core = build(ROBOT, tmp_path)
    assert core.step == 40
    assert core.missing({}) == (at(SENSES, "r1"),)


def test_the_part_says_ready_with_its_kernels_and_records_what_it_was_started_with(tmp_path: Path) -> None:
    robot = part(ActorSetup(ROBOT, PLACE), tmp_path)
    assert robot.ready == to(READY, Ready(40, "r1", 2, combined(kernels())), "r1")
    assert [address.key for address in robot.listens] == ["swarm/down/r1/senses", "swarm/down/r1/received"]
    assert (robot.run.actor, robot.run.seed, robot.run.step_us, robot.run.commit) == (
        "r1.2",
        7,
        50_000,
        "abc",
    )
    assert msgspec.json.decode(robot.run.setup, type=RobotSetup) == ROBOT
    ours = [name for name in sorted(robot.run.kernels) if not name.startswith("actors.portable.")]
    assert ours == [
        "actors.floor.distance",
        "actors.floor.flood",
        "actors.robot.cost_maps.cell_distance",
        "actors.robot.cost_maps.footprint",
        "actors.robot.cost_maps.inflation",
        "actors.robot.cost_maps.ray_tracing",
        "actors.robot.local_planning.control_cycle",
        "actors.robot.local_planning.disc_dwa",
        "actors.robot.local_planning.dwa",
        "actors.robot.local_planning.local_plan",
        "actors.robot.local_planning.map_grid",
        "actors.robot.localisation.beams",
        "actors.robot.localisation.confidence",
        "actors.robot.localisation.evidence",
        "actors.robot.localisation.histogram",
        "actors.robot.localisation.line_of_sight",
        "actors.robot.localisation.measurement",
        "actors.robot.localisation.motion",
        "actors.robot.localisation.resampling",
        "actors.robot.navigation.navfn_potential",
        "actors.robot.navigation.potential",
    ]


def _actor(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda told: told["actor"].update({name: value})


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (_actor("id", 'r1\n'), 'actor.id is "r1\\n"' + AN_ID),
        (_actor("seed", "x"), 'actor.seed is "x", but must be a whole number'),
        (_actor("start", [1, 2]), "actor.start is [1, 2], but must be a list of length 3"),
        (_actor("places", [[1, True]]), "actor.places[0][1] is true, but must be a number"),
        (
            lambda told: told["actor"]["stack"]["dwa"].update(speed=1),
            "actor.stack.dwa.speed is not known; did you mean actor.stack.dwa.min_speed?",
        ),
        (
            lambda told: told["actor"]["stack"]["localisation"].update(beams=0),
            "actor.stack.localisation: localisation.beams is 0, but must be at least 1",
        ),
        (
            lambda told: told["process"].update(limits={"memory_mb": 0}),
            "process.limits.memory_mb is 0, but must be a whole number of at least 1",
        ),
        (lambda told: told.pop("process"), "process is missing, but must be there"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_it_is_one_sentence(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[dict[str, Any]], object],
    fault: str,
) -> None:
    told = json.loads(setup_bytes(ActorSetup(ROBOT, PLACE)))
    change(told)
    file = tmp_path / SETUP
    file.write_text(json.dumps(told))
    with pytest.raises(AcrcError) as caught:
        load_setup(file)
    assert str(caught.value) == f"{file}: no set-up of a robot: {fault}"
    assert robot_program.main([str(file)]) == 2
    assert capsys.readouterr().err == f"{caught.value}\n"


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(AcrcError) as caught:
        load_setup(tmp_path / SETUP)
    assert str(caught.value) == (
        f"{tmp_path}/{SETUP}: the set-up of a robot cannot be read: No such file or directory"
    )
