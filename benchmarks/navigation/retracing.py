"""The motion of a run between its steps, computed again from what the robots wished."""

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import outline
from actors.floor.map_file import load_map
from actors.geometry import Pose, Twist
from actors.instant import Instant
from actors.robot_model import load_model
from actors.world.physics import SUBSTEP, Arena
from actors.world.world_setup import WorldSetup
from observation.accounting.tracks import Tracks


class RetracingError(Exception):
    """The motion comes out otherwise than it was."""


def retrace(world: WorldSetup, tracks: Tracks) -> tuple[NDArray[np.float64], int]:
    """The true poses at the end of every sub-step, (samples, robots, 3), and how many contacts began.

    For runs in which all robots drive in every step and no event happens. Raises RetracingError unless every
    step begins exactly where the run has it.
    """
    arena = Arena(
        outline(load_map(world.map)),
        [robot.id for robot in world.robots],
        [load_model(robot.model, robot.sensor) for robot in world.robots],
        [Pose(*robot.start) for robot in world.robots],
    )
    parts = []
    for step, (true, wished) in enumerate(zip(tracks.true, tracks.wished, strict=True)):
        if not np.array_equal(arena.poses, true):
            raise RetracingError(f"step {step} begins elsewhere than in the run")
        for robot, wish in enumerate(wished.tolist()):
            arena.command(robot, Twist(*wish), Instant(step * tracks.step_us))
        parts.append(arena.advance(tracks.step_us // SUBSTEP))
    return np.concatenate(parts), arena.contacts
