"""No step of a robot waits for the compiler: what its kernels are called with is compiled before the run."""

import subprocess
import sys
from pathlib import Path

import pytest

from actors.robot import assembly
from actors.runtime.fingerprint import fingerprints

ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys
from numba.core.dispatcher import Dispatcher
from actors.geometry import Point, Pose
from actors.robot import assembly
from actors.robot.behaviour.ports import Decision
from actors import toml_file
from deploy.scenario.stack_tables import stack
from actors.robot_model import load_model
from tests.robot.base import TWO_ROOMS, FakeBase

def variants():
    kernels = [k for m in assembly.KERNELS for k in vars(m).values() if isinstance(k, Dispatcher)]
    return sum(len(kernel.signatures) for kernel in kernels)

assembly.kernels()
compiled = variants()
model, start = load_model("turtlebot2", "chapter"), Pose(1.0, 1.0, 0.0)
told = assembly.RobotSetup(
    "r1", 0, 0, 7, 100_000, 1, (*start,), (), "tests.robot.behaviours:idle", "turtlebot2",
    stack=stack(toml_file.loads(sys.argv[1])),
)
core, base = assembly.robot(told, model, TWO_ROOMS), FakeBase(TWO_ROOMS, model, start)
core._parts.behaviour.decision = Decision(Point(9.0, 3.0), peers=(Point(2.0, 2.0),))
base.obstacles = [(Point(4.7, 1.75), 0.2)]
for step in range(120):
    (output,) = core.advance({"swarm/down/r1/senses": base.senses(step)})
    base.drive(output.message)
    core._parts.behaviour.decision = Decision()
print(compiled > 0, variants() - compiled)
"""


@pytest.mark.parametrize("preset", ["chapter", "robust"])
def test_no_step_waits_for_the_compiler(preset: str) -> None:
    stack = f'localisation.preset = "{preset}"\nnavigation.preset = "{preset}"'
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, stack],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert (ran.stdout, ran.returncode) == ("True 0\n", 0), ran.stderr


def test_fingerprints_repeat() -> None:
    """Of all kernels of a robot."""
    first = fingerprints(assembly.KERNELS)
    assert first == fingerprints(assembly.KERNELS) and len(first) >= len(assembly.KERNELS)
