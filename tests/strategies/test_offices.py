"""Offices as groups: doorkeepers, admission, bundles, and that no place is lost."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from acrc_testbed.recordings.record_replay import replay_actor
from acrc_testbed.testing import VirtualSwarm
from actors.geometry import Point
from actors.instant import seconds
from actors.items import ItemKey
from actors.messages import FRAME_DATA_LIMIT
from cleaning.place import Assignment
from cleaning.strategies.auction import Auction, BiddingRobot, HigherBid
from cleaning.strategies.offices import (
    Office,
    OfficeBidder,
    OfficeBiddingParameters,
    OfficeQueue,
    OfficeRobot,
    behaviour,
)
from deeco.fragments import Fragmenter
from deeco.group_protocol import GroupOffer
from deeco.packet import KnowledgePacket, Version, pack
from deeco.schema import RoleRegistry
from tests.cleaning.fakes import DOORWAY, NOW, Action, ScriptedSwarm, published
from tests.recorded_runs import record

seen = partial(published, role=OfficeBidder)
AUCTION, OUTBID, OFFICE, QUEUE = Auction(), HigherBid(), Office(), OfficeQueue()
WEST, EAST = 1, 2


def robot(name: str, at: float, *xs: float) -> OfficeRobot:
    """Return a robot at x = `at`, m, with planned places at `xs`; both rooms of DOORWAY have one door."""
    places = tuple(Assignment(name, index, Point(x, 0.0)) for index, x in enumerate(xs))
    return OfficeRobot(id=name, position=Point(at, 0.0), route=places).plan(DOORWAY)


def keys(one: BiddingRobot) -> list[ItemKey]:
    return [place.key for place in one.route]


def test_a_robot_publishes_its_office_and_its_places_in_one_office() -> None:
    r1 = robot("r1", -5.0, -8.0, -7.0, 4.0)
    assert (r1.office, r1.bundle_office) == (WEST, EAST) and [one.index for one in r1.bundle] == [2]
    assert robot("r1", -5.0, -8.0).bundle_office == WEST
    door = robot("r1", 0.2, 4.0, 6.0)
    assert (door.office, door.bundle_office, len(door.bundle)) == (WEST, EAST, 2)
    assert robot("r1", -5.0, 4.0, 6.0).bundle_saving > 2 * max(one.saving for one in door.bids)
    assert not robot("r1", 5.0, 1.0, 2.0, 3.0, 4.0, 6.0).bundle, "too many"
    assert not robot("r1", -5.0).bundle


def test_the_group_of_an_office_selects_robots_with_places_there() -> None:
    keeper, guest = seen(robot("r1", 5.0, 6.0)), seen(robot("r2", -5.0, 3.0, 4.0))
    assert OFFICE.select_guests(keeper, guest) and OFFICE.utility_guests(keeper, guest) == 2
    assert not OFFICE.select_guests(guest, keeper)
    inside = seen(robot("r3", 7.0, 4.0))
    assert OFFICE.select_guests(keeper, inside) and not OFFICE.select_guests(inside, keeper)


def test_a_doorkeeper_adopts_places_together_that_no_bid_for_one_of_them_moves() -> None:
    keeper, guest = robot("r1", 5.0, 1.0), robot("r2", -5.0, -4.0, 8.0, 8.5)
    taken = OFFICE.at_coordinator(keeper, seen(guest), DOORWAY)
    assert set(keys(taken)) == {ItemKey("r1", 0), ItemKey("r2", 1), ItemKey("r2", 2)}
    for bid in guest.bids:
        alone = AUCTION.at_member(replace(seen(guest), bids=(bid,)), robot("r1", 5.0, 1.0), DOORWAY)
        assert bid.assignment.index != 2 or keys(alone) == [ItemKey("r1", 0)]
    left = OUTBID.at_member(seen(taken.plan(DOORWAY)), guest, NOW)
    assert keys(left) == [ItemKey("r2", 0)]
    busy, near = robot("r1", 9.0, 3.0, 9.5), seen(robot("r2", -1.0, 1.0))
    assert OFFICE.at_coordinator(busy, near, DOORWAY) is busy, "its load is higher"


def test_a_robot_that_is_not_admitted_visits_its_other_places_first() -> None:
    keeper, guest = robot("r1", 5.0, 6.0), robot("r2", -1.5, 1.5, -9.0)
    assert keys(guest) == [ItemKey("r2", 0), ItemKey("r2", 1)]
    guest = guest.heading_for(guest.route[0])
    assert QUEUE.membership(seen(keeper), guest)
    offer = GroupOffer("Office", "guests", "r1", "r2", NOW, 0.0, 1.0)
    assert not QUEUE.membership(seen(keeper), replace(guest, group_confirmations=(offer,)))
    queued = QUEUE.at_member(seen(keeper), guest)
    waiting = queued.plan(DOORWAY)
    assert keys(waiting) == [ItemKey("r2", 1), ItemKey("r2", 0)] and waiting.destination == waiting.route[0]
    assert waiting.plan(DOORWAY).attempt == waiting.attempt, "the order is stable"
    assert keys(queued.without({ItemKey("r2", 1)}, settled=True).plan(DOORWAY)) == [ItemKey("r2", 0)]
    assert keys(QUEUE.at_member_end(seen(keeper), queued).plan(DOORWAY)) == keys(guest)
    free = replace(queued, parameters=OfficeBiddingParameters(admit=False))
    assert keys(free.plan(DOORWAY)) == keys(guest)


def test_one_robot_at_a_time_is_admitted() -> None:
    points = {"r1": [5.0, 5.5, 6.0], "r2": [-5.0, 7.0], "r3": [-6.0, 8.0, 8.5]}
    swarm = VirtualSwarm(
        behaviour, DOORWAY, {name: [Point(x, 0.0) for x in xs] for name, xs in points.items()}
    )
    admitted = set[tuple[str, ...]]()
    for second in range(1, 9):
        swarm.advance(seconds(second))
        keeper = swarm["r1"].knowledge
        assert isinstance(keeper, OfficeRobot)
        admitted.add(tuple(one.member for one in keeper.held_offers("Office")))
    assert admitted == {(), ("r3",)}, "it has more places there"
    assert {key.owner for key in swarm["r1"].route} == {"r1", "r2", "r3"}
    assert not swarm["r2"].route and not swarm["r3"].route


def test_knowledge_fits_three_frames() -> None:
    places = tuple(Assignment("r8", index, Point(8.123, 0.456), 9) for index in range(2))
    one = OfficeRobot(id="r8", position=Point(8.123, 0.456), route=places, destination=places[0])
    for index in (8, 9):
        one = one.insert_place(Assignment("r7", index, Point(8.0, 0.0), 8), 0)
    one = replace(one.plan(DOORWAY), office=WEST)
    offer = GroupOffer("Office", "guests", "r8", "r7", NOW, 0.0, 4.0, True, True)
    one = replace(one, group_offers=(offer,), group_confirmations=(offer,))
    assert len(one.bundle) == 4 and len(one.bids) == 3
    data = pack(KnowledgePacket("r8", Version(1, 600), 3, RoleRegistry([OfficeBidder]).pack(one)))
    frames = Fragmenter(1).frames([data])
    assert len(frames) == 3 and all(len(frame) <= FRAME_DATA_LIMIT for frame in frames)


class Swarm(ScriptedSwarm[OfficeRobot]):
    def __init__(self, robots: int, places: int) -> None:
        own = [[float(4 * index - 9 + number) for index in range(places)] for number in range(robots)]
        super().__init__([robot(f"r{number}", 3.0 * number - 7, *xs) for number, xs in enumerate(own)])

    def _publish(self, one: OfficeRobot, number: int) -> OfficeRobot:
        self.published.append(seen(one))
        return one

    def _hear(self, one: OfficeRobot, number: int) -> OfficeRobot:
        peer = self.message(one, number)
        if peer is None:
            return one
        return one.adopt_cheaper(peer, DOORWAY).leaving_to(peer, NOW, exchange=False)

    def _adopt(self, one: OfficeRobot, number: int) -> OfficeRobot:
        peer = self.message(one, number)
        return one if peer is None else OFFICE.at_coordinator(one, peer, DOORWAY)

    def _queue(self, one: OfficeRobot, number: int) -> OfficeRobot:
        peer = self.message(one, number)
        return one if peer is None or peer.office is None else QUEUE.at_member(peer, one)

    def _plan(self, one: OfficeRobot, number: int) -> OfficeRobot:
        return one.plan(DOORWAY)

    def _move(self, one: OfficeRobot, number: int) -> OfficeRobot:
        return replace(one, position=Point(2.0 * number - 9, 0.3)).set_destination(self.monitor, self.now)


ACTS = ("publish", "publish", "hear", "adopt", "adopt", "queue", "plan", "plan", "move")


@settings(max_examples=60, deadline=None)
@given(
    st.integers(2, 5),
    st.integers(1, 3),
    st.lists(
        st.builds(Action, st.sampled_from(ACTS), st.integers(0, 4), st.integers(0, 9)),
        min_size=20,
        max_size=80,
    ),
)
def test_no_place_is_lost(robots: int, places: int, script: list[Action]) -> None:
    Swarm(robots, places).play(script)


def test_a_robot_of_a_run_equals_its_replay(tmp_path: Path) -> None:
    record(tmp_path / "run", strategy="offices", duration=6.0)
    assert replay_actor(tmp_path / "run", "r1").outputs > 60
