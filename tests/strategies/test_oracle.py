"""The upper bound: robots of one process know all of one another; alone it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceKey
from cleaning.strategies.oracle import behaviour
from tests.cleaning.equipment import Floor


def start(robot: str, x: float, *places: float) -> Start:
    points = tuple(Point(place, 0.0) for place in places)
    generator = np.random.default_rng(1)
    return Start(robot, 1, 0, Pose(x, 0.0, 0.0), points, generator, floor=Floor())


def step(hosted: Behaviour, x: float, number: int) -> Decision:
    view = View(Instant(number * 100_000), Pose(x, 0.0, 0.0), False, None, ())
    return hosted.advance(view, Instant((number + 1) * 100_000))


def test_places_go_to_whom_they_cost_least_without_a_frame_and_runs_do_not_mix() -> None:
    for _ in range(2):
        r1, r2 = behaviour(start("r1", 0.0, 1.0, 20.0)), behaviour(start("r2", 21.0))
        routes: dict[str, tuple[PlaceKey, ...]] = {}
        for number in range(40):
            for name, hosted, x in (("r1", r1, 0.0), ("r2", r2, 21.0)):
                said = step(hosted, x, number)
                assert said.frames == ()
                routes[name] = routes.get(name, ()) if said.route is None else said.route
        assert routes == {"r1": (PlaceKey("r1", 0),), "r2": (PlaceKey("r1", 1),)}


def test_it_refuses_where_it_knows_of_nobody() -> None:
    behaviour(start("r1", 0.0, 1.0))
    alone = behaviour(start("r1", 0.0, 1.0))
    with pytest.raises(
        AcrcError, match="knows of nobody else; it is an upper bound for runs with `--bus memory`"
    ):
        for number in range(12):
            step(alone, 0.0, number)


def test_a_restarted_robot_stays_in_its_run() -> None:
    behaviour(start("r1", 0.0, 1.0)), behaviour(start("r2", 9.0))
    again = behaviour(replace(start("r2", 9.0), epoch=1))
    for number in range(12):
        step(again, 9.0, number)
