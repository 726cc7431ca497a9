"""A scene without a run: a bus on which the test is the run, and a floor that is taken apart once."""

from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.messages import CONTROL, Control, RobotTruth
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.topic import Message, Topic
from actors.world.world_setup import BodySetup, TimedOrder, WorldSetup
from deploy.control import scene as scenes
from deploy.control.page_floor import PageFloor


def truth_of(robot: str, x: float, y: float, *, stepping: bool = True, powered: bool = True) -> RobotTruth:
    return RobotTruth(robot, x, y, 0.5, 0, 0, 0, stepping=stepping, powered=powered, transmits=0)


TRUTH_OF_R1 = truth_of("r1", 12.0, 13.0)


MAP = REPOSITORY / "maps" / "corridor.yaml"


class Mesh:
    """A bus on which the test is the run."""

    def __init__(self) -> None:
        self.given: list[Control] = []
        self.says: dict[str, list[bytes]] = {}

    def publish(self, key: str, payload: bytes) -> None:
        told = decode(at(CONTROL).topic, key, payload)
        assert isinstance(told, Control)
        self.given.append(told)

    def receive(self, topic: Topic[Message]) -> Delivery:
        """Nobody waits for what the test has not said."""
        raise NotImplementedError

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        waiting = self.says.get(topic.pattern)
        return Delivery(topic, topic.key("r2"), waiting.pop(0)) if waiting else None


def scene(*events: TimedOrder, others: int = 0) -> scenes.Scene:
    robots = (
        BodySetup("r1", "turtlebot2", None, "exact", (12.0, 13.0, 0.0), ((13.0, 13.0), (14.0, 13.0))),
        *(
            BodySetup(f"r{number}", "turtlebot2", None, "exact", (12.0, 13.0, 0.0), ())
            for number in range(2, others + 2)
        ),
    )
    setup = WorldSetup(str(MAP), 1, 100_000, 1_000_000, robots, events)
    addresses = {number: robot.id for number, robot in enumerate(robots, start=1)}
    return scenes.Scene(setup, plan_for(others, setup), 2.0, addresses)


PLANS: dict[int, PageFloor] = {}


def plan_for(others: int, setup: WorldSetup) -> PageFloor:
    """That of a floor with so many other robots: to find its doors takes half a second."""
    if others not in PLANS:
        PLANS[others] = PageFloor(setup, load_map(MAP))
    return PLANS[others]
