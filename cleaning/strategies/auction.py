"""Places go to whom they cost least: a decentralised auction by the length of ways, with a charge for doors.

Idea: prevent instead of cure; when each office and each stretch of the corridor is one robot's, few meet.
Source: Choi, Brunet, How 2009 (CBBA) and Johnson et al. 2011 (ACBBA); how, `cleaning.bidding` says. Limits:
it knows of others only what arrives by radio, balances loads and does not see who will meet whom; a robot
that is killed keeps its places. Settings: `BiddingParameters`.
"""

from actors.robot.behaviour import Behaviour, Start, host
from cleaning.bidding import Auction, BiddingParameters, BiddingRobot, Outbid
from cleaning.place import assignments
from cleaning.settings import from_settings
from cleaning.yielding import SteppingAside, Yielding


def behaviour(start: Start) -> Behaviour:
    """Auction places by the length of ways with a charge for doors, again and again, also when stuck."""
    parameters = from_settings(BiddingParameters, start.settings)
    robot = BiddingRobot(
        id=start.robot, position=start.pose.point, route=assignments(start), parameters=parameters
    )
    p = parameters
    yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks)
    further: list[object] = [SteppingAside(p.yield_distance)] if p.make_way else []
    return host(start, robot, Auction(), Outbid(), yielding, *further)
