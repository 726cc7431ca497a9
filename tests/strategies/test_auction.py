"""The auction: adoptions, and that no place is lost whatever happens to messages."""

from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acrc_testbed.testing import TextFloor
from actors.geometry import Point
from actors.items import ItemKey
from actors.messages import FRAME_DATA_LIMIT
from cleaning.cleaner import State
from cleaning.place import Assignment
from cleaning.strategies.auction import Auction, Bidder, BiddingParameters, BiddingRobot, HigherBid
from deeco.fragments import Fragmenter
from deeco.packet import KnowledgePacket, Version, pack
from deeco.schema import RoleRegistry
from tests.cleaning.fakes import (
    DOORWAY,
    NOW,
    OPEN,
    Action,
    FakeTaskMonitor,
    ScriptedSwarm,
    assignment,
    published,
)

seen = partial(published, role=Bidder)
AUCTION, OUTBID = Auction(), HigherBid()


def bidder(robot: str, at: float, *xs: float) -> BiddingRobot:
    """Return a robot at x = `at`, m, with planned places at `xs`."""
    places = tuple(Assignment(robot, index, Point(x, 0.0)) for index, x in enumerate(xs))
    return BiddingRobot(id=robot, position=Point(at, 0.0), route=places).plan(OPEN)


def hears(member: BiddingRobot, peer: Bidder, floor: TextFloor = OPEN) -> BiddingRobot:
    if AUCTION.membership(peer, member):
        member = AUCTION.at_member(peer, member, floor)
    return OUTBID.at_member(peer, member, NOW) if OUTBID.membership(peer, member) else member


def keys(robot: BiddingRobot) -> set[ItemKey]:
    return {place.key for place in robot.route}


def test_a_place_goes_to_the_cheapest_robot_without_changing_destinations() -> None:
    r1, r2 = bidder("r1", 0.0, 1.0, 20.0), bidder("r2", 21.0, 22.0)
    r2 = r2.set_destination(FakeTaskMonitor(), NOW)
    taken = hears(r2, seen(r1))
    assert keys(taken) == {ItemKey("r2", 0), ItemKey("r1", 1)} and taken.destination == r2.destination
    assert taken.adopted[-1].key == ItemKey("r1", 1)
    assert keys(hears(r1, seen(taken.plan(OPEN)))) == {ItemKey("r1", 0)}
    r1, r2 = bidder("r1", 0.0, 1.0, 2.0), bidder("r2", 21.0, 22.0)
    assert hears(r2, seen(r1)) == r2 and hears(r1, seen(r2)) == r1, "nothing is worth it"


def test_a_door_raises_the_cost_of_a_place() -> None:
    r1, r2 = bidder("r1", 7.0, 2.0), bidder("r2", -1.0)
    assert keys(hears(r2, seen(r1))) == {ItemKey("r1", 0)}
    assert not hears(r2, seen(r1), DOORWAY).route


def test_places_of_a_blocked_robot_are_adopted() -> None:
    r1, r2 = bidder("r1", 0.0, 1.0), bidder("r2", 8.0)
    assert not hears(r2, seen(r1)).route
    stuck = replace(r1, state=State.BLOCKED, stuck_for=20).plan(OPEN)
    assert keys(hears(r2, seen(stuck))) == {ItemKey("r1", 0)}
    assert not hears(replace(r2, state=State.BLOCKED), seen(stuck)).route, "a blocked robot adopts nothing"


def test_of_two_robots_that_adopt_a_place_the_greater_id_keeps_it() -> None:
    r1 = bidder("r1", 0.0, 1.0, 20.0)
    r2, r3 = (hears(bidder(name, 21.0), seen(r1)).plan(OPEN) for name in ("r2", "r3"))
    assert keys(r2) == keys(r3) == {ItemKey("r1", 1)}
    assert not hears(r2, seen(r3)).route and keys(hears(r3, seen(r2))) == keys(r3)


def test_all_places_are_published_in_rotation() -> None:
    robot, told = bidder("r1", 0.0, *(float(x) for x in range(8))), set[ItemKey]()
    for _ in range(3):
        told |= {bid.assignment.key for bid in robot.bids}
        robot = robot.plan(OPEN)
    assert told == keys(robot)


def test_a_bid_is_one_frame() -> None:
    robots = BiddingParameters().most_bids
    places = tuple(Assignment("r8", index, Point(28.123, 13.456), 9) for index in range(10))
    robot = BiddingRobot(
        id="r8", position=Point(28.123, 13.456), state=State.BLOCKED, route=places, destination=places[0]
    )
    for place in (Assignment("r7", 8, Point(3.0, 4.0), 8), Assignment("r6", 9, Point(3.0, 4.0), 8)):
        robot = robot.insert_place(place, 0)
    robot = robot.plan(OPEN)
    assert len(robot.bids) == robots and len(robot.adopted) == 2
    data = pack(KnowledgePacket("r8", Version(1, 600), 3, RoleRegistry([Bidder]).pack(robot)))
    (frame,) = Fragmenter(1).frames([data])
    assert len(frame) <= FRAME_DATA_LIMIT


class Swarm(ScriptedSwarm[BiddingRobot]):
    def __init__(self, robots: int, places: int) -> None:
        own = [[float(4 * index + number) for index in range(places)] for number in range(robots)]
        super().__init__([bidder(f"r{number}", 3.0 * number, *xs) for number, xs in enumerate(own)])

    def _publish(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        self.published.append(seen(robot))
        return robot

    def _hear(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        peer = self.message(robot, number)
        return robot if peer is None else hears(robot, peer)

    def _plan(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        return robot.plan(OPEN)

    def _move(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        return replace(robot, position=Point(3.0 * number, 0.3)).set_destination(self.monitor, self.now)

    def _block(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        return replace(robot, state=State.BLOCKED, stuck_for=9 * number)

    def _free(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        return replace(robot, state=State.FREE)

    def _give_up(self, robot: BiddingRobot, number: int) -> BiddingRobot:
        if not robot.route or number % 4:
            return robot
        return robot.given_up(robot.route[0], "a test", self.monitor, self.now)


OFTEN = ("publish", "hear", "hear", "plan", "plan")
acts = st.builds(
    Action,
    st.sampled_from((*OFTEN, "move", "block", "free", "give_up")),
    st.integers(0, 4),
    st.integers(0, 9),
)


@pytest.mark.claim("places")
@settings(max_examples=80, deadline=None)
@given(st.integers(2, 5), st.integers(1, 3), st.lists(acts, min_size=20, max_size=80))
def test_no_place_is_lost(robots: int, places: int, script: list[Action]) -> None:
    Swarm(robots, places).play(script)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 5), st.integers(1, 3), st.lists(acts, min_size=20, max_size=60))
def test_finally_each_place_is_held_once(robots: int, places: int, script: list[Action]) -> None:
    swarm = Swarm(robots, places).play(script)
    for _ in range(12 * places):  # no further adoptions, and all messages arrive
        swarm.robots = [robot.plan(OPEN) for robot in swarm.robots]
        told = [seen(robot) for robot in swarm.robots]
        for index in range(robots):
            for role in told:
                if role.id != swarm.robots[index].id and OUTBID.membership(role, swarm.robots[index]):
                    swarm.robots[index] = OUTBID.at_member(role, swarm.robots[index], swarm.now)
        swarm.check()
    swarm.check_held_once()


def test_a_lost_place_is_adopted_back_with_a_higher_term() -> None:
    r1, r2 = bidder("r1", 0.0, 1.0, 20.0), bidder("r2", 21.0)
    r2 = hears(r2, seen(r1)).plan(OPEN)
    r1 = hears(r1, seen(r2)).plan(OPEN)
    r2 = replace(r2, state=State.BLOCKED, stuck_for=60).plan(OPEN)
    r1 = hears(replace(r1, position=Point(19.0, 0.0)), seen(r2))
    assert assignment(20.0, 1, "r1", 2) in r1.route
    assert not hears(r2, seen(r1.plan(OPEN))).route
