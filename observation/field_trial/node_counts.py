"""What a robot's node of the component model did, by its last record or, without one, by its messages."""

from collections import Counter
from typing import NamedTuple

from actors.instant import Instant
from deeco.replication.packet import unpack
from deeco.replication.reassembly import Reassembly
from observation.field_trial.robot_log import RobotLog
from observation.results.deeco_result import NodeOutcome, node_outcome
from observation.results.outcome import OutcomeError


class NodeAccount(NamedTuple):
    """What is known of one node."""

    node: NodeOutcome | None
    """None: the robot has none, as far as can be told."""
    notes: tuple[str, ...]
    """What is not known, a sentence each."""


def node_account(log: RobotLog) -> NodeAccount:
    """What the node of one robot's process did."""
    if log.final is not None:
        try:
            return NodeAccount(node_outcome(log.path, log.final.outcome), ())
        except OutcomeError as error:
            return NodeAccount(_told(log), (f"{error}; counted from its messages instead",))
    told = _told(log)
    if told is None:
        return NodeAccount(None, ())
    note = f"{log.path}: has no last record, so of its node only packets and frames are counted"
    return NodeAccount(told, (note,))


def _told(log: RobotLog) -> NodeOutcome | None:
    """What the frames tell: packets published, relayed and heard; None if there are no packets in them."""
    robot = log.identity.id
    counters = Counter(
        dict.fromkeys(("published", "frames", "packets", "packets_junk", "packets_own", "relayed"), 0)
    )
    counters["frames"] = log.frames_handed
    own = Reassembly()
    for sent in log.sent:
        for data in own.take(Instant(sent.handed.instant), log.identity.address, sent.data):
            packet = unpack(data)
            if packet is not None:
                counters["relayed" if packet.component != robot else "published"] += 1
    others = Reassembly()
    for heard in log.heard:
        for data in others.take(Instant(heard.heard.instant), heard.sender, heard.data):
            packet = unpack(data)
            counters["packets"] += 1
            counters["packets_junk"] += packet is None
            counters["packets_own"] += packet is not None and packet.component == robot
    if not counters["published"] and counters["packets"] == counters["packets_junk"]:
        return None
    return NodeOutcome(dict(counters), {}, {})
