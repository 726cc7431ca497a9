"""The robot's set-up file, process and entry strings."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.floor.placement import Area
from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.instant import seconds
from actors.messages import READY, SENSES, Ready
from actors.randomness import derived_seed, generator
from actors.robot import __main__ as robot_program
from actors.robot.assembly import RobotSetup, kernels
from actors.robot.behaviour.loading import BehaviourError, load_behaviour
from actors.robot.behaviour.ports import ExchangeSettings, Start
from actors.robot.localisation import PRESETS
from actors.robot.program import RobotProcess, RobotProgram, actor_process, build, load_setup
from actors.robot.stack import Adaptation, Stack
from actors.runtime import typed_json
from actors.runtime.core import at, to
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process_setup import SETUP, ActorSetup
from actors.runtime.processor import combine_fingerprints
from actors.user_code import FINDER
from tests.refusals import refused
from tests.robot.rig import ScriptedBehaviour

MAPS = Path(__file__).parents[2] / "maps"
ROBOT = RobotSetup(
    id="r1",
    epoch=2,
    first_step=40,
    seed=7,
    step_us=50_000,
    address=3,
    members=(("r1", 3), ("r2", 4)),
    start=(12.0, 5.0, 4.0),
    items=([12.5, 6.0], [9.0, 12.25]),
    behaviour="tests.robot.rig:keeper",
    model="turtlebot2",
    sensor="kinect",
    map=str(MAPS / "corridor.yaml"),
)
PLACE = RobotProcess(record="r1.2.mcap", router="router.sock", credentials="credentials", commit="abc")
NAVIGATION_KERNELS = "cost_map disc_dwa dwa local_planner map_grid potential ray_tracing"
LOCALISATION_KERNELS = "confidence measurement motion resampling"
AN_ID = r", but must be a string of the form '\\A[A-Za-z0-9_-]{1,32}\\Z'"


def test_a_setup_survives_a_round_trip(tmp_path: Path) -> None:
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
    with refused(f"{tmp_path}/{SETUP}: the set-up of a robot cannot be read: No such file or directory"):
        load_setup(tmp_path / SETUP)
    (tmp_path / SETUP).write_bytes(typed_json.dump(told))
    assert load_setup(tmp_path / SETUP) == told


def test_the_core_begins_with_the_step_and_listens_to_its_own_keys(tmp_path: Path) -> None:
    core = build(ROBOT, tmp_path)
    assert core.step == 40 and ROBOT.pose == pytest.approx(Pose(12.0, 5.0, 4.0 - math.tau))
    assert core.missing({}) == (at(SENSES, "r1"),)
    actor_process(ActorSetup(ROBOT, msgspec.structs.replace(PLACE, code=("/one", "two"))), tmp_path)
    assert FINDER.folders == (Path("/one"), tmp_path / "two")
    actor_process(ActorSetup(ROBOT, PLACE), tmp_path)


def test_a_robots_process_reports_its_kernels_and_records_its_setup(tmp_path: Path) -> None:
    robot = actor_process(ActorSetup(ROBOT, PLACE), tmp_path)
    assert robot.ready == to(READY, Ready(40, "r1", 2, combine_fingerprints(kernels())), "r1")
    assert [address.key for address in robot.listens] == ["swarm/down/r1/senses", "swarm/down/r1/received"]
    run = robot.run
    assert (run.actor, run.seed, run.step_us, run.commit) == ("r1.2", 7, 50_000, "abc")
    assert msgspec.json.decode(robot.run.setup, type=RobotSetup) == ROBOT
    ours = [name for name in sorted(robot.run.kernels) if not name.startswith("actors.portable.")]
    assert [name.removeprefix("actors.") for name in ours] == [
        *("floor.raster.distance", "floor.raster.flood"),
        *(f"robot.localisation.{name}" for name in LOCALISATION_KERNELS.split()),
        *(f"robot.navigation.{name}" for name in NAVIGATION_KERNELS.split()),
    ]


def _actor(name: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda told: told["actor"].update({name: value})


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (_actor("id", 'r1\n'), 'actor.id is "r1\\n"' + AN_ID),
        (_actor("seed", "x"), 'actor.seed is "x", but must be a whole number'),
        (_actor("start", [1, 2]), "actor.start is [1, 2], but must be a list of length 3"),
        (_actor("items", 1), "actor.items is 1, but must be a list"),
        (lambda told: told["actor"]["stack"]["dwa"].update(speed=1),
         "unknown key actor.stack.dwa.speed; remove it"),
        (lambda told: told["actor"]["stack"]["localisation"].update(beams=0),
         "actor.stack.localisation.beams is 0, but must be a whole number of at least 1"),
        (lambda told: told["process"].update(limits={"memory_mb": 0}),
         "process.limits.memory_mb is 0, but must be a whole number of at least 1"),
        (lambda told: told.pop("process"), "process is missing"),
    ],
)  # fmt: skip
def test_a_faulty_setup_gives_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Callable[[dict[str, Any]], object], fault: str
) -> None:
    told = json.loads(typed_json.dump(ActorSetup(ROBOT, PLACE)))
    change(told)
    file = tmp_path / SETUP
    file.write_text(json.dumps(told))
    with pytest.raises(AcrcError) as caught:
        load_setup(file)
    assert str(caught.value) == f"{file}: invalid set-up of a robot: {fault}"
    assert robot_program.main([str(file)]) == 2
    assert capsys.readouterr().err == f"{caught.value}\n"


START = Start("r1", 1, 0, Pose(0.0, 0.0, 0.0), (Point(1.0, 2.0),), generator(1, "behaviour", "r1"))


FORM = "is not an entry; it should look like 'package.module:behaviour'"


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        ("cleaning.strategies.none", " " + FORM),
        (":behaviour", " " + FORM),
        ("cleaning.strategies.none:", " " + FORM),
        (".baseline:behaviour", " " + FORM),
        ("nowhere.study:behaviour", ": there is no module 'nowhere' on Python's path"),
        ("tests.none:behaviour", ": there is no module 'tests.none' on Python's path"),
        ("tests.robot.rig:other", ": module 'tests.robot.rig' has no 'other'; did you mean behaviour?"),
        ("tests.robot.rig:number", " is a int, but should be a function of a Start"),
        ("tests.robot.rig:nothing", " returned a NoneType, which has no method advance(view, until)"),
    ],
)
def test_an_invalid_entry(entry: str, fault: str) -> None:
    with refused(f"behaviour {entry!r}{fault}", BehaviourError):
        load_behaviour(entry, START)


def test_errors_of_the_users_own_code_are_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    behaviour = load_behaviour("tests.robot.rig:keeper", START)
    assert isinstance(behaviour, ScriptedBehaviour) and behaviour.decision is not None
    with pytest.raises(ZeroDivisionError):
        load_behaviour("tests.robot.rig:fails", START)
    (tmp_path / "study_without_library.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(tmp_path)
    with refused(
        "behaviour 'study_without_library:behaviour': study_without_library imports 'no_such_library', which "
        "is not installed; `acrc add NAME` installs a package by its name on PyPI",
        BehaviourError,
    ):
        load_behaviour("study_without_library:behaviour", START)
    (tmp_path / "study_of_a_part.py").write_text("import json.no_such_part\n")
    with pytest.raises(ModuleNotFoundError) as caught:
        load_behaviour("study_of_a_part:behaviour", START)
    assert caught.value.name == "json.no_such_part"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("def behaviour(start):\n    return 1 +\n", "{file.name}:2: invalid syntax: return 1 +"),
        ("import sys\nsys.exit('no')\n", "its code called sys.exit('no') ({file.name}:2)"),
        ("def behaviour(start):\n    exit(3)\n", "its code called sys.exit(3) ({file.name}:2)"),
    ],
)
def test_code_with_a_syntax_error_or_exit_gives_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, fault: str
) -> None:
    file = tmp_path / f"study_{abs(hash(text))}.py"
    file.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with refused(f"behaviour '{file.stem}:behaviour': {fault.format(file=file)}", BehaviourError):
        load_behaviour(f"{file.stem}:behaviour", START)


def draws(seed: int = 1, purpose: str = "noise", actor: str = "r1", epoch: int = 0) -> tuple[int, ...]:
    return tuple(int(n) for n in generator(seed, purpose, actor, epoch).integers(2**62, size=4))


EXPECTED = (181797799603694115, 2812094438849263835, 3263301756773372310, 3580450795074921962)


def test_equal_arguments_give_equal_draws_in_every_version() -> None:
    assert draws() == draws() == EXPECTED
    others: list[dict[str, Any]] = [{"seed": 2}, {"purpose": "noises"}, {"actor": "r2"}, {"epoch": 1}]
    others += [{}, {"purpose": "r1", "actor": "noise"}, {"purpose": "nois", "actor": "er1"}]
    assert len({draws(**other) for other in others}) == len(others)
    seeds = [derived_seed(7, "r1"), derived_seed(7, "r2"), derived_seed(8, "r1")]
    assert len({7, 8, *seeds}) == 5
    assert all(0 <= seed < 2**63 for seed in seeds)
    assert derived_seed(7, "r1") == seeds[0]


SCRIPT = """
from numba.core.dispatcher import Dispatcher
from actors.settings import loads
from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Drive
from actors.robot import assembly
from actors.robot.behaviour.ports import Decision
from actors.robot_model import load_model
from actors.runtime.processor import fingerprints
from actors.task.loading import task_setup
from cleaning.task import CleaningTask
from actors.world.program import KERNELS, build
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup
from actors.robot.stack import stack
from tests.robot.base import TWO_ROOMS, FakeBase

def variants():
    modules = (*assembly.KERNELS, *KERNELS, *CleaningTask.kernels)
    kernels = [k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)]
    return sum(len(kernel.signatures) for kernel in kernels)

def run_robot(preset):
    model, start = load_model("turtlebot2", "chapter"), Pose(1.0, 1.0, 0.0)
    presets = stack(loads(f'localisation.preset = "{preset}"\\nnavigation.preset = "{preset}"'))
    setup = assembly.RobotSetup(
        "r1", "turtlebot2", None, (*start,), (), epoch=0, first_step=0, seed=7, step_us=100_000, address=1,
        behaviour="tests.robot.rig:idle", stack=presets
    )
    core, base = assembly.robot(setup, model, TWO_ROOMS), FakeBase(TWO_ROOMS, model, start)
    core.behaviour.decision = Decision(Point(9.0, 3.0), peers=(Point(2.0, 2.0),))
    base.obstacles = [(Point(4.7, 1.75), 0.2)]
    for step in range(120):
        (output,) = core.advance({"swarm/down/r1/senses": base.senses(step)})
        base.drive(output.message)
        core.behaviour.decision = Decision()

def run_world(odometry, uncertainty):
    kinds = (("turtlebot2", odometry), ("omnibox", "stage"))
    robots = tuple(
        BodySetup(f"r{k}", model, None, (12.0 + 1.2 * k, 13.0, 3.0 * k), ((13.0, 13.0),), odometry=kind)
        for k, (model, kind) in enumerate(kinds)
    )
    task = task_setup("cleaning", {})
    setup = WorldSetup("maps/corridor.yaml", 1, 100_000, 3_000_000, robots, task, uncertainty=uncertainty)
    core = build(setup)
    bodies = core._bodies
    for step in range(30):
        now = Instant(100_000 * step)
        for index in range(2):
            bodies.senses(index, step, now, 0, False)
            bodies.command(index, Drive(step, 0.3, 0.1, 0.2, 0, (), (), None), now)
        if step == 9:
            bodies.add_obstacle(12.0, 14.0, 0.2)
            bodies.place(0, Pose(17.0, 13.0, 1.0))
        bodies.move(now, 100_000)
        core.judge.watch(now, bodies.positions)

assembly.kernels()
fingerprints((*KERNELS, *CleaningTask.kernels))
compiled = variants()
for preset in ("chapter", "robust"):
    run_robot(preset)
for odometry in ("exact", "stage", "kobuki"):
    for uncertainty in (Uncertainty(), Uncertainty(0.02, 0.1, 3, 2.0)):
        run_world(odometry, uncertainty)
print(compiled > 0, variants() - compiled)
"""


def test_no_step_waits_for_the_compiler() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert (ran.stdout, ran.returncode) == ("True 0\n", 0), ran.stderr
