"""UPPER BOUND, no strategy for robots: the auction among robots that know everything of one another at once.

Idea: how much of what is left to gain is the radio's. Each robot looks into all others' knowledge of this
very second, outside of the radio, and its transceiver is silent. Source: own; the planning is that of
`auction`, with all places told of at a time. Limits: it is the bound for that planning, not the optimum.
Robots in processes of their own share no memory, by design, so it works with `--bus memory` only, for two
robots or more, and refuses all else with a sentence. Settings: `BiddingParameters`.
"""

from dataclasses import dataclass, field
from typing import Self

from actors.robot.behaviour import Behaviour, FloorPlan, Start, host
from actors.runtime.errors import AcrcError
from cleaning.settings import from_settings
from cleaning.strategies.auction import Auction, BiddingParameters, BiddingRobot, Outbid
from cleaning.strategies.chapter import Mute
from cleaning.yielding import SteppingAside, Yielding
from deeco import Instant, adaptation, component, periodic, replace, seconds


@dataclass(frozen=True)
class OracleParameters(BiddingParameters):
    """The auction's numbers; a frame is no limit here."""

    most_bids: int = 60
    """So many places a robot tells of at a time: all that it may come to hold."""


@dataclass
class _Board:
    """What the robots of one run know of one another."""

    members: set[str] = field(default_factory=set)
    known: dict[str, "OracleRobot"] = field(default_factory=dict)


_boards: list[_Board] = [_Board()]
"""The board of the run that this process has begun last; robots of another run do not live any more."""


@component
class OracleRobot(BiddingRobot):
    """Bids on what it sees on the board."""

    parameters: OracleParameters = OracleParameters()

    @adaptation
    @periodic(every=seconds(1), order=2)
    def consult(self, floor: FloorPlan, now: Instant) -> Self:
        """Take over, drop, and give way by what the others know now."""
        board, p, robot = _boards[-1], self.parameters, self
        if len(board.members) < 2 and now >= seconds(1):
            raise AcrcError(
                f"the oracle of {self.id} knows of nobody else; it is an upper bound for runs with "
                "`--bus memory` and two robots or more, as robots in processes of their own share nothing"
            )
        yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks)
        aside = SteppingAside(p.yield_distance)
        for name in sorted(board.known):
            peer = board.known[name]
            if name == self.id:
                continue
            if Outbid().membership(peer, robot):
                robot = robot.leaving_to(peer, now, exchange=False)
            if Auction().membership(peer, robot):
                robot = robot.bidding(peer, floor, now)
            if yielding.membership(peer, robot):
                robot = robot.yielding(floor, now)
            if p.make_way and aside.membership(peer, robot):
                robot = replace(robot, waypoint=aside.at_member(peer, robot, floor).waypoint)
        board.known[self.id] = robot
        return robot


def behaviour(start: Start) -> Behaviour:
    """UPPER BOUND, memory bus only: the auction among robots that know all of one another, without radio."""
    if start.robot in _boards[-1].members and not start.epoch:
        _boards[:] = [_Board()]
    _boards[-1].members.add(start.robot)
    robot = OracleRobot.at_start(start, from_settings(OracleParameters, start.settings))
    return Mute(host(start, robot))
