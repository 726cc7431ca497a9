"""A connection through a relay: two directions, in which each byte goes on at its own instant."""

import socket
import struct
from collections import deque
from typing import Final

MOST: Final = 32 << 20
"""Bytes on their way in one direction. Beyond that the sender waits, as it does for a slow receiver."""
_CHUNK: Final = 1 << 16
_COST: Final = 256
"""What a chunk takes beside its bytes, so that many small ones are bounded as well."""


class Direction:
    """The bytes from one end to the other, in their order."""

    def __init__(self, source: socket.socket, sink: socket.socket) -> None:
        self.source = source
        self.sink = sink
        self.blocked = False
        """The sink takes nothing more at present."""
        self.done = False
        """All has been given, and the sink knows that nothing follows."""
        self._ended = False
        self._held = 0
        self._chunks: deque[tuple[float, memoryview]] = deque()

    @property
    def wants(self) -> bool:
        """True if there may be more to take, and there is room for it."""
        return not self._ended and self._held < MOST

    def take(self, due: float) -> None:
        """Take what the source has sent, to be given at `due`. Raises OSError if the source is gone."""
        data = self.source.recv(_CHUNK)
        self._chunks.append((due, memoryview(data)))
        self._held += len(data) + _COST
        self._ended = not data

    def give(self, now: float) -> None:
        """Give what is due, as far as the sink takes it. Raises OSError if the sink is gone."""
        self.blocked = False
        while self._chunks and self._chunks[0][0] <= now:
            due, data = self._chunks[0]
            if not data:
                self.done = True
                self._chunks.popleft()
                self.sink.shutdown(socket.SHUT_WR)
                return
            try:
                sent = self.sink.send(data)
            except BlockingIOError:
                self.blocked = True
                return
            self._held -= sent
            if sent < len(data):
                self._chunks[0] = (due, data[sent:])
            else:
                self._held -= _COST
                self._chunks.popleft()


class DelayedConnection:
    """Both directions between a client and the target, on sockets that do not block."""

    def __init__(self, client: socket.socket, target: socket.socket) -> None:
        self.ends = (client, target)
        self.closed = False
        for one in self.ends:
            one.setblocking(False)
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        out, back = Direction(client, target), Direction(target, client)
        self.taken_from = {client: out, target: back}
        self.given_to = {target: out, client: back}

    @property
    def done(self) -> bool:
        """True if nothing follows in either direction."""
        return all(one.done for one in self.taken_from.values())

    def close(self, *, cut: bool) -> None:
        """Close both ends. `cut`: at once and by a reset (RST), and what is on its way is lost."""
        self.closed = True
        for one in self.ends:
            if cut:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.close()
