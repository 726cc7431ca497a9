"""A door is held by one robot, or by one direction: `chapter`, and nobody meets head-on in a door.

Idea: prevent what the chapter cures; waiting for one robot takes 4 to 7 s, a blocking 15 to 30. Source:
own, after reservations of edges in multi-robot planning; how, `cleaning.leasing` says. Limits: robots that
do not hear each other through the wall both hold the door, and one backs out once they meet; open floor is
as it was. Settings: `LeasingParameters`.
"""

from actors.robot.behaviour import Behaviour, Start, host
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.leasing import DoorRivals, DoorsCleared, LeasingParameters, LeasingRobot
from cleaning.place import assignments
from cleaning.settings import from_settings
from cleaning.yielding import SteppingAside, Yielding


def behaviour(start: Start) -> Behaviour:
    """As the chapter's, with doors that one direction has at a time, and robots that back out."""
    p = from_settings(LeasingParameters, start.settings)
    robot = LeasingRobot(id=start.robot, position=start.pose.point, route=assignments(start), parameters=p)
    return host(
        start,
        robot,
        DestinationAdoption(p.adoption_distance, p.adoption_checks, p.adoption_backoff),
        AdoptedDestinationRemove(p.exchange),
        DoorRivals(),
        DoorsCleared(p.yield_distance),
        Yielding(p.yield_distance, p.yield_checks, p.insist_checks),
        SteppingAside(p.yield_distance),
    )
