"""Adversaries: robots that use their radio against the other robots.

An adversary drives and works by the run's strategy, which receives and sends nothing. Its own frames obey
CSMA/CA and the limits of robots, and nothing is random. `mute` sends no frames: it is the control of the
other kinds, because it does not cooperate either.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import count
from typing import ClassVar, Final

from actors.instant import START, Instant, seconds
from actors.messages import FRAME_DATA_LIMIT, MOST_FRAMES, FrameReceived, OutgoingFrame
from actors.robot.behaviour.node_host import network_parameters
from actors.robot.behaviour.ports import Behaviour, Decision, Start, View
from actors.robot_model import AdversaryKind
from deeco import ExecutionError
from deeco.fragments import Fragmenter, Reassembly
from deeco.packet import KnowledgePacket, Unpacker, Version, pack

_MOST_WAITING: Final = 4096
"""Frames that wait for a later step; more than the air can carry in 10 s."""
_REPLAY_DELAY: Final = seconds(10)
"""Age of replayed frames; twice the age at which the shipped strategies ignore positions and bids."""
_NEVER_REACHED: Final = 2**63 - 1
"""Epoch above that of any robot."""


class SilentBehaviour:
    """A behaviour without radio."""

    def __init__(self, hosted: Behaviour, start: Start) -> None:
        self.hosted = hosted
        self._start = start
        self._waiting: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._tags = count(start.epoch << 32)

    def advance(self, view: View, until: Instant) -> Decision:
        """Advance the behaviour without radio events; replace its frames by those of `frames`."""
        decision = self.hosted.advance(view._replace(radio=()), until)
        self._waiting.extend(self.frames(view))
        size = min(len(self._waiting), MOST_FRAMES)
        instants = [view.instant + (until - view.instant) * index // size for index in range(size)]
        sent = [OutgoingFrame(next(self._tags), instant, self._waiting.popleft()) for instant in instants]
        return replace(decision, frames=tuple(sent))

    def frames(self, view: View) -> Iterable[bytes]:
        """Return the data of the frames to send after this step's radio events; none by default."""
        return ()


class Flooder(SilentBehaviour):
    """An adversary that always has full frames to send."""

    def frames(self, view: View) -> Iterable[bytes]:
        """Return as many of the longest frames as a robot may send in a step."""
        return [bytes(FRAME_DATA_LIMIT)] * MOST_FRAMES


class Replayer(SilentBehaviour):
    """An adversary that sends all received frames again, unchanged."""

    def __init__(self, hosted: Behaviour, start: Start) -> None:
        super().__init__(hosted, start)
        self._received: deque[FrameReceived] = deque(maxlen=_MOST_WAITING)

    def frames(self, view: View) -> Iterator[bytes]:
        """Yield the frames received 10 s ago."""
        self._received.extend(event for event in view.radio if isinstance(event, FrameReceived))
        while self._received and self._received[0].instant + _REPLAY_DELAY <= view.instant:
            yield self._received.popleft().data


class PacketAdversary(SilentBehaviour):
    """An adversary that publishes false knowledge."""

    has_key: ClassVar = False
    """True: uses the scenario's key, if there is one. Packets are readable without it."""

    def __init__(self, hosted: Behaviour, start: Start) -> None:
        super().__init__(hosted, start)
        authenticator = network_parameters(start).authenticator
        self._authenticator = authenticator if self.has_key else None
        self._tag_size = 0 if authenticator is None else authenticator.tag_size
        self._reassembly, self._unpacker = Reassembly(), Unpacker()
        self._fragmenter = Fragmenter(start.address)
        self._peers: dict[str, KnowledgePacket] = {}
        """Last packet of each peer."""
        self._next, self._published = START, 0

    def frames(self, view: View) -> Iterable[bytes]:
        """Return the frames of this step's packets."""
        packets: list[bytes] = []
        for packet in self.packets(view):
            with suppress(ExecutionError, OverflowError):  # values of others: too long in another packet
                packets.append(pack(packet, authenticator=self._authenticator))
        return self._fragmenter.frames(packets)

    def packets(self, view: View) -> Iterator[KnowledgePacket]:
        """Yield the packets to send after this step's radio events."""
        raise NotImplementedError

    def _publication(self, now: Instant) -> int:
        """Return the number of the publication that is due now, as often as of others; 0: none is."""
        if now < self._next:
            return 0
        self._next, self._published = Instant(now + self._start.exchange.publish), self._published + 1
        return self._published

    def _receive(self, view: View) -> Iterator[KnowledgePacket]:
        """Yield and keep the packets received from their own robots, without relayed ones."""
        for event in view.radio:
            if not isinstance(event, FrameReceived):
                continue
            for data in self._reassembly.take(Instant(event.instant), event.sender, event.data):
                packet = self._unpacker.unpack(data[: len(data) - self._tag_size])
                if packet is not None and self._start.members.get(packet.component) == event.sender:
                    self._peers[packet.component] = packet
                    yield packet


class Forger(PacketAdversary):
    """An adversary that publishes the knowledge of one robot under the id of another."""

    def packets(self, view: View) -> Iterator[KnowledgePacket]:
        """Yield a newer packet after each one of a robot: the knowledge of the robot before it by id."""
        for packet in self._receive(view):
            names = sorted(self._peers)
            other = names[names.index(packet.component) - 1]
            if other != packet.component:
                epoch, counter = packet.version
                yield packet._replace(version=Version(epoch, counter + 1), roles=self._peers[other].roles)


class Liar(PacketAdversary):
    """A member of the swarm that publishes the knowledge of others as its own: positions, claims, bids."""

    has_key = True

    def packets(self, view: View) -> Iterator[KnowledgePacket]:
        """Yield the knowledge of one robot after the other, one in each period of publication."""
        deque(self._receive(view), maxlen=0)
        if self._peers and (number := self._publication(view.instant)):
            names = sorted(self._peers)
            roles = self._peers[names[number % len(names)]].roles
            yield KnowledgePacket(self._start.robot, Version(self._start.epoch, number), 0, roles)


class Silencer(PacketAdversary):
    """An adversary that publishes under the ids of all robots, with an epoch that they never reach."""

    def packets(self, view: View) -> Iterator[KnowledgePacket]:
        """Yield, in each period, a packet without roles for each robot; its own packets are older then."""
        if number := self._publication(view.instant):
            for robot in self._start.members:
                if robot != self._start.robot:
                    yield KnowledgePacket(robot, Version(_NEVER_REACHED, number), 0, ())


_KINDS: Final[Mapping[AdversaryKind, type[SilentBehaviour]]] = {
    "mute": SilentBehaviour,
    "forger": Forger,
    "replayer": Replayer,
    "silencer": Silencer,
    "flooder": Flooder,
    "liar": Liar,
}


def adversary(kind: AdversaryKind, hosted: Behaviour, start: Start) -> Behaviour:
    """Return an adversary that drives and works like `hosted`."""
    return _KINDS[kind](hosted, start)
