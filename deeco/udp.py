"""UDP link: runs a node in real time and exchanges its frames as datagrams.

    asyncio.run(UdpLink(7000, ["192.168.1.255:7000"]).run(node))

Instants are µs since the start of the link. Without an authenticator in the node's parameters anybody in the
network can publish knowledge. Bytes of datagrams are untrusted; invalid ones only increment counters.
"""

import asyncio
import socket
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random  # noqa: TID251  # of a link in real time, not of a core
from typing import Any, Final

from deeco.errors import DeploymentError, ExecutionError
from deeco.instant import Duration, Instant, check_duration, milliseconds, seconds
from deeco.link import Reception
from deeco.node import Node

MAX_DATAGRAM: Final = 1472
"""Bytes of a datagram that fits an Ethernet frame (1500 without the headers of IPv4 and UDP)."""
MAX_LAG: Final = seconds(1)
"""A node that is further behind real time, as after a computer's sleep, skips what it has missed."""
_STEP: Final = milliseconds(50)


@dataclass
class UdpCounters:
    """Counts of datagrams."""

    sent: int = 0
    received: int = 0
    """Datagrams given to the node."""
    lost: int = 0
    """Received datagrams dropped by the configured loss."""
    oversized: int = 0
    """Received datagrams longer than MAX_DATAGRAM."""
    overflow: int = 0
    """Datagrams dropped because the queue of received ones, or the socket's buffer, was full."""
    errors: int = 0
    """Errors of the socket, such as an unreachable peer."""


class UdpLink(asyncio.DatagramProtocol):
    """Link of one node over IPv4; every frame is sent to all peers."""

    def __init__(
        self,
        port: int,
        peers: Sequence[str],
        *,
        host: str = "0.0.0.0",
        loss: float = 0.0,
        seed: int = 1,
        step: Duration = _STEP,
        max_waiting: int = 256,
    ) -> None:
        """Create the link; `run` opens its socket.

        `port`, `host`: local address. `peers`: addresses "host:port", also of a network's broadcast.
        `loss`: probability that a received datagram is dropped; `seed`: of these draws. `step`: period in
        which the node processes received datagrams; `max_waiting`: their maximum number until then. Raises
        DeploymentError for a wrong value.
        """
        self._local = _address("port", f"{host}:{port}")
        self._peers = [_address("peers", peer) for peer in peers]
        if not 0 <= loss <= 1:
            raise DeploymentError(f"UdpLink: loss={loss}; must be from 0 to 1")
        check_duration("UdpLink: step", step)
        self.counters = UdpCounters()
        self._loss, self._draw = loss, Random(seed).random
        self._step, self._max_waiting = step, max_waiting
        self._begin = 0
        self._received: list[Reception] = []
        self._is_full = False

    async def run(self, node: Node, duration: Duration | None = None) -> None:
        """Run a new node until it is cancelled or `duration` has passed.

        Raises DeploymentError if the socket cannot be opened or a peer's name is unknown.
        """
        loop = asyncio.get_running_loop()
        try:
            found = [await loop.getaddrinfo(*peer, family=socket.AF_INET) for peer in self._peers]
            transport, _ = await loop.create_datagram_endpoint(
                lambda: self, local_addr=self._local, family=socket.AF_INET, allow_broadcast=True
            )
        except OSError as error:
            raise DeploymentError(f"UdpLink: {error}; check port {self._local[1]} and the peers") from None
        targets = [addresses[0][4] for addresses in found]
        self._begin = time.monotonic_ns() // 1000 - node.now
        end = None if duration is None else node.now + duration
        try:
            while end is None or node.now < end:
                await asyncio.sleep((node.now + self._step - self._now()) / 1e6)
                now = self._now()
                if now - node.now > MAX_LAG:
                    node.skip(Instant(now - self._step))
                received, self._received = self._received, []
                for frame in node.advance(now, received):
                    self._send(transport, frame.data, targets)
        finally:
            transport.close()

    def _now(self) -> Instant:
        return Instant(time.monotonic_ns() // 1000 - self._begin)

    def _send(self, transport: asyncio.DatagramTransport, data: bytes, targets: Sequence[Any]) -> None:
        if len(data) > MAX_DATAGRAM:
            raise ExecutionError(
                f"UdpLink: a frame has {len(data)} bytes; at most {MAX_DATAGRAM} are allowed "
                "(LinkParameters.frame_data)"
            )
        for target in targets:
            if self._is_full:
                self.counters.overflow += 1
            else:
                self.counters.sent += 1
                transport.sendto(data, target)

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        """Queue a datagram for the next step, unless it is lost, too long or one too many."""
        counters = self.counters
        if len(data) > MAX_DATAGRAM:
            counters.oversized += 1
        elif self._draw() < self._loss:
            counters.lost += 1
        elif len(self._received) >= self._max_waiting:
            counters.overflow += 1
        else:
            counters.received += 1
            sender = zlib.crc32(f"{addr[0]}:{addr[1]}".encode())
            self._received.append(Reception(self._now(), sender, data))

    def error_received(self, exc: Exception) -> None:
        """Count an error of the socket."""
        self.counters.errors += 1

    def pause_writing(self) -> None:
        """Drop frames: the socket's buffer is full."""
        self._is_full = True

    def resume_writing(self) -> None:
        """Send frames again."""
        self._is_full = False


def _address(name: str, text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise DeploymentError(
            f"UdpLink: {name} {text!r} must be host:port, such as 192.168.1.255:7000; ports are 1 to 65535"
        )
    return host, int(port)
