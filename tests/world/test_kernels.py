"""No step of a world waits for the compiler: what its kernels are called with is compiled before the run."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys
from numba.core.dispatcher import Dispatcher
from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import Drive
from actors.runtime.fingerprint import fingerprints
from actors.world.body import Bodies
from actors.world.program import KERNELS
from actors.task.referee import Referee
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import BodySetup, WorldSetup

def variants():
    kernels = [k for m in KERNELS for k in vars(m).values() if isinstance(k, Dispatcher)]
    return sum(len(kernel.signatures) for kernel in kernels)

fingerprints(KERNELS)
compiled = variants()
robots = tuple(
    BodySetup(f"r{k}", model, None, odometry, (12.0 + 1.2 * k, 13.0, 3.0 * k), ((13.0, 13.0),))
    for k, (model, odometry) in enumerate((("turtlebot2", sys.argv[1]), ("omnibox", "stage")))
)
dose = Uncertainty(0.02, 0.1, 3, 2.0) if sys.argv[2] == "uncertain" else Uncertainty()
setup = WorldSetup("maps/corridor.yaml", 1, 100_000, 3_000_000, robots, uncertainty=dose)
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
print(compiled > 0, variants() - compiled, bodies.contacts > 0)
"""


@pytest.mark.parametrize("floor", ["as mapped", "uncertain"])
@pytest.mark.parametrize("odometry", ["exact", "stage", "kobuki"])
def test_no_step_waits_for_the_compiler(odometry: str, floor: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, odometry, floor],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert (ran.stdout[:7], ran.returncode) == ("True 0 ", 0), ran.stderr
