"""Makes the first robot's behaviour once in the parent: what is wrong is said before anything is started."""

import contextlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from actors.geometry import Point, Pose
from actors.map_file import load_map
from actors.robot import setup
from actors.robot.adaptation import adaptation
from actors.robot.behaviour import load_behaviour
from actors.robot.program import look_in
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from deploy.cast import Cast


def rehearse(settled: Cast, text: str, modules: Sequence[Path]) -> None:
    """Make the first robot's behaviour as its process will, told the adaptation.toml `text`, and drop it.

    Raises an AcrcError for settings, areas or equipment that do not fit, and for an entry that leads nowhere.
    Any other error is in the strategy's own code, and is passed on with a note of which one it is.
    """
    name, robot = settled.scenario.run.strategy, settled.world.robots[0]
    behaviour = setup.RobotSetup(
        id=robot.id,
        epoch=0,
        first_step=0,
        seed=settled.world.seed,
        step_us=settled.world.step_us,
        address=dict(settled.radio.robots)[robot.id],
        start=Pose(*robot.start),
        places=tuple(Point(*place) for place in robot.places),
        behaviour=settled.behaviour,
        adaptation=adaptation(text),
    )
    model = load_model(robot.model, robot.sensor)
    floor = setup.floor(load_map(settled.world.map), model, behaviour.stack)
    start = setup.start(behaviour, model, floor)
    with _found(modules), contextlib.redirect_stdout(sys.stderr):  # --json leaves nothing else there
        try:
            load_behaviour(settled.behaviour, start)
        except AcrcError:
            raise
        except Exception as error:
            which = repr(name) if name == settled.behaviour else f"{name!r}, {settled.behaviour!r},"
            error.add_note(f"in strategy {which} made for {robot.id} before the run")
            raise


@contextlib.contextmanager
def _found(modules: Sequence[Path]) -> Iterator[None]:
    """Python finds modules in these folders, too, for as long as it lasts."""
    before = sys.path[:]
    look_in(modules)
    try:
        yield
    finally:
        sys.path[:] = before
