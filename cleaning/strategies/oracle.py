"""UPPER BOUND, not a strategy for robots: the auction with instantaneous global knowledge.

Idea: bound the gain from better communication. Each robot reads the current knowledge of all others in
memory and does not use the radio. Source: own; planning as in `auction`, with all places published at once.
Limits: a bound for this planning, not the optimum. Works with `--bus memory` only, since robots in separate
processes share no memory, and with two robots or more; otherwise raises an error. Settings:
`OracleParameters`.
"""

from dataclasses import dataclass, field
from typing import Self

from actors.robot.behaviour import Behaviour, FloorPlan, SilentBehaviour, Start, from_settings, host
from actors.runtime.errors import AcrcError
from cleaning.strategies.auction import Auction, BiddingParameters, BiddingRobot, HigherBid
from cleaning.yielding import SteppingAside, Yielding
from deeco import Instant, adaptation, component, periodic, replace, seconds


@dataclass(frozen=True)
class OracleParameters(BiddingParameters):
    """Parameters of the auction, without the limit of a frame."""

    most_bids: int = 60
    """Number of places published at a time: more than any robot holds."""


@dataclass
class _Board:
    """Shared knowledge of the robots of a run."""

    members: set[str] = field(default_factory=set)
    known: dict[str, "OracleRobot"] = field(default_factory=dict)


_boards: list[_Board] = [_Board()]
"""The board of the run started last in this process; robots of earlier runs no longer exist."""


@component
class OracleRobot(BiddingRobot):
    """A robot that bids using the board."""

    parameters: OracleParameters = OracleParameters()

    @adaptation
    @periodic(every=seconds(1), order=2)
    def consult(self, floor: FloorPlan, now: Instant) -> Self:
        """Adopt and drop places, and yield, using the current knowledge of the others."""
        board, p, robot = _boards[-1], self.parameters, self
        if len(board.members) < 2 and now >= seconds(1):
            raise AcrcError(
                f"the oracle of {self.id} finds no other robot in this process; it needs `--bus memory` and "
                "two robots or more"
            )
        yielding = Yielding(p.yield_distance, p.yield_checks, p.insist_checks)
        aside = SteppingAside(p.yield_distance)
        for name in sorted(board.known):
            peer = board.known[name]
            if name == self.id:
                continue
            if HigherBid().membership(peer, robot):
                robot = robot.leaving_to(peer, now, exchange=False)
            if Auction().membership(peer, robot):
                robot = robot.adopt_cheaper(peer, floor)
            if yielding.membership(peer, robot):
                robot = robot.request_back_out(floor, now)
            if p.make_way and aside.membership(peer, robot):
                robot = replace(robot, waypoint=aside.at_member(peer, robot, floor).waypoint)
        board.known[self.id] = robot
        return robot


def behaviour(start: Start) -> Behaviour:
    """Compute an UPPER BOUND: `auction` with instantaneous global knowledge; memory bus only."""
    if start.robot in _boards[-1].members and not start.epoch:
        _boards[:] = [_Board()]
    _boards[-1].members.add(start.robot)
    robot = OracleRobot.at_start(start, from_settings(OracleParameters, start.settings))
    return SilentBehaviour(host(start, robot), start)
