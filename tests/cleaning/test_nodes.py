"""The robots of the model problem on nodes of their own, joined by radio, standing head to head."""

from numpy.random import Generator

from actors.geometry import Point, Pose
from actors.randomness import generator
from actors.robot.behaviour import FloorPlan, Navigation, PlaceMonitor, Positioning, TaskList
from actors.task.words import PlaceKey
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.cleaner import Cleaner, State
from cleaning.robot import CleaningRobot
from deeco import Knowledge, seconds
from deeco.node import Node
from tests.cleaning.equipment import Base, Floor, Notes, Tasks, Ways, adaptive, assignment
from tests.deeco.air import Air, everywhere

ENSEMBLES = (DestinationAdoption(1.5, 1, seconds(10)), AdoptedDestinationRemove(exchange=True))


def node(robot: CleaningRobot, ways: Ways, number: int) -> Node:
    ports = {
        Positioning: Base(Pose(*robot.position, 0.0)),
        Navigation: ways,
        TaskList: Tasks(),
        PlaceMonitor: Notes(),
        FloorPlan: Floor(),
        Generator: generator(1, "behaviour", robot.id, 0),
    }
    ensembles = ENSEMBLES if isinstance(robot, AdaptiveCleaningRobot) else ()
    return Node([robot], ensembles, ports=ports, address=number)


def route_of(air: Air, robot: str) -> list[PlaceKey]:
    knowledge: Knowledge = air.nodes[robot].knowledge(robot)
    assert isinstance(knowledge, CleaningRobot)
    return [assignment.key for assignment in knowledge.route]


def test_two_that_stand_head_to_head_turn_round_with_each_others_destinations() -> None:
    r1, r2 = adaptive("r1", 0.0, 5.0), adaptive("r2", 1.0, -5.0)
    ways = {"r1": Ways(), "r2": Ways()}
    air = Air({one.id: node(one, ways[one.id], number) for number, one in enumerate((r1, r2), start=1)})
    air.run(seconds(9.5))
    assert route_of(air, "r1") == [PlaceKey("r2", 0)] and route_of(air, "r2") == [PlaceKey("r1", 0)]
    assert ways["r1"].orders == [Point(5.0, 0.0), Point(-5.0, 0.0)]
    assert ways["r2"].orders == [Point(-5.0, 0.0), Point(5.0, 0.0)]


def test_who_has_not_been_heard_of_for_long_takes_no_part() -> None:
    """In the released code a robot that has long gone goes on being blocked for ever."""
    for audible, expected in ((True, PlaceKey("r2", 0)), (False, PlaceKey("r1", 0))):
        ghost = CleaningRobot(
            id="r2", position=Point(1.0, 0.0), state=State.BLOCKED, route=(assignment(9.0, owner="r2"),)
        )
        nodes = {"r1": node(adaptive("r1", 0.0, 5.0), Ways(), 1), "r2": node(ghost, Ways(), 2)}
        air = Air(nodes)
        air.run(seconds(0.5))
        air.reach = everywhere if audible else lambda sender, receiver: None
        air.run(seconds(6))
        knowledge = nodes["r1"].knowledge("r1")
        assert isinstance(knowledge, Cleaner) and knowledge.destination is not None
        assert knowledge.destination.key == expected
        assert [one.id for one in nodes["r1"].replicas] == ["r2"], "the node itself has not forgotten it"
