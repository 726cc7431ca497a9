"""No step waits for the compiler: all variants of kernels are compiled before the run."""

import subprocess
import sys

from actors.installation.repository import REPOSITORY
from actors.robot import assembly
from actors.runtime.processor import fingerprints
from actors.world.program import KERNELS

SCRIPT = """
from numba.core.dispatcher import Dispatcher
from actors import toml_file
from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Drive
from actors.robot import assembly
from actors.robot.behaviour.ports import Decision
from actors.robot_model import load_model
from actors.runtime.processor import fingerprints
from actors.task.referee import Referee
from actors.world.body import Bodies
from actors.world.program import KERNELS
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup
from deploy.scenario.stack_tables import stack
from tests.robot.base import TWO_ROOMS, FakeBase

def variants():
    modules = (*assembly.KERNELS, *KERNELS)
    kernels = [k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)]
    return sum(len(kernel.signatures) for kernel in kernels)

def run_robot(preset):
    model, start = load_model("turtlebot2", "chapter"), Pose(1.0, 1.0, 0.0)
    presets = stack(toml_file.loads(f'localisation.preset = "{preset}"\\nnavigation.preset = "{preset}"'))
    setup = assembly.RobotSetup(
        "r1", 0, 0, 7, 100_000, 1, (*start,), (), "tests.robot.behaviours:idle", "turtlebot2", stack=presets
    )
    core, base = assembly.robot(setup, model, TWO_ROOMS), FakeBase(TWO_ROOMS, model, start)
    core._parts.behaviour.decision = Decision(Point(9.0, 3.0), peers=(Point(2.0, 2.0),))
    base.obstacles = [(Point(4.7, 1.75), 0.2)]
    for step in range(120):
        (output,) = core.advance({"swarm/down/r1/senses": base.senses(step)})
        base.drive(output.message)
        core._parts.behaviour.decision = Decision()

def run_world(odometry, uncertainty):
    kinds = (("turtlebot2", odometry), ("omnibox", "stage"))
    robots = tuple(
        BodySetup(f"r{k}", model, None, kind, (12.0 + 1.2 * k, 13.0, 3.0 * k), ((13.0, 13.0),))
        for k, (model, kind) in enumerate(kinds)
    )
    setup = WorldSetup("maps/corridor.yaml", 1, 100_000, 3_000_000, robots, uncertainty=uncertainty)
    bodies, referee = Bodies(setup), Referee(robots, setup.reach)
    for step in range(30):
        now = Instant(100_000 * step)
        for index in range(2):
            bodies.senses(index, step, now, 0, False)
            bodies.command(index, Drive(step, 0.3, 0.1, 0.2, 0, (), (), None), now)
        if step == 9:
            bodies.add_obstacle(12.0, 14.0, 0.2)
            bodies.place(0, Pose(17.0, 13.0, 1.0))
        bodies.move(now, 100_000)
        referee.watch(now, bodies.positions)

assembly.kernels()
fingerprints(KERNELS)
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


def test_fingerprints_of_all_kernels_repeat() -> None:
    for modules in (assembly.KERNELS, KERNELS):
        first = fingerprints(modules)
        assert first == fingerprints(modules) and len(first) >= len(modules)
