"""What a relay does with connections: passes on each byte when it is due, in one thread."""

import heapq
import itertools
import os
import select
import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from actors.runtime.errors import AcrcError
from benchmarks.hosts.delayed import DelayedConnection

Address = tuple[str, int]


class TcpRelay:
    """Listens, passes on, and obeys, in one thread."""

    def __init__(self, listen: Address, target: Address, delay_s: float) -> None:
        self._target = target
        self._delay_s = delay_s
        self._stalled = False
        self._connections: set[DelayedConnection] = set()
        self._selector = selectors.EpollSelector()
        self._due: list[tuple[float, int, DelayedConnection, socket.socket]] = []
        """A heap of when something is to be given to a socket, in the order in which it was taken."""
        self._number = itertools.count()
        self._listener = _listening(listen)
        self.address: Address = self._listener.getsockname()[:2]
        self._watch(self._listener, selectors.EVENT_READ, self._accept)

    def add_input(self, descriptor: int, read: Callable[[int], None]) -> None:
        """Call `read` whenever there is input."""
        self._selector.register(descriptor, selectors.EVENT_READ, read)

    def step(self) -> None:
        """Wait until something comes or is due, and do it."""
        timeout = None
        if self._due and not self._stalled:
            timeout = max(0.0, self._due[0][0] - time.monotonic())
        select.select([self._selector], [], [], timeout)  # epoll by itself counts whole milliseconds
        for key, events in self._selector.select(0):
            key.data(events)
        self._give(time.monotonic())

    def set_delay(self, delay_s: float) -> None:
        """Delay by so much what is taken from now on."""
        self._delay_s = delay_s

    def stall(self) -> None:
        """Take nothing and give nothing until `go`."""
        self._stalled = True
        self._watch_all()

    def refuse(self) -> None:
        """Have connections refused until `go`."""
        self._watch(self._listener, 0, self._accept)
        self._listener.close()

    def cut(self) -> None:
        """Reset all connections."""
        for one in list(self._connections):
            self._end(one, cut=True)

    def go(self) -> None:
        """End stall and refuse."""
        self._stalled = False
        if self._listener.fileno() < 0:
            self._listener = _listening(self.address)
        self._watch_all()

    def _give(self, now: float) -> None:
        while self._due and self._due[0][0] <= now and not self._stalled:
            _, _, connection, sink = heapq.heappop(self._due)
            if not connection.closed and not connection.given_to[sink].blocked:
                self._move(connection, sink, selectors.EVENT_WRITE)

    def _accept(self, _: int) -> None:
        if self._listener.fileno() < 0 or self._stalled:
            return
        try:
            client, _ = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):  # it has gone again
            return
        target = socket.socket(self._listener.family)
        connection = DelayedConnection(client, target)
        target.connect_ex(self._target)
        self._connections.add(connection)
        self._watch_ends(connection)

    def _move(self, connection: DelayedConnection, end: socket.socket, events: int) -> None:
        """Take from an end, give to it, or both; an end that is gone resets the other one."""
        if connection.closed or self._stalled:  # since this round began
            return
        now = time.monotonic()
        try:
            if events & selectors.EVENT_WRITE:
                connection.given_to[end].give(now)
            if events & selectors.EVENT_READ:
                self._take(connection, end, now + self._delay_s)
        except OSError:
            self._end(connection, cut=True)
            return
        if connection.done:
            self._end(connection, cut=False)
        else:
            self._watch_ends(connection)

    def _take(self, connection: DelayedConnection, end: socket.socket, due: float) -> None:
        taken = connection.taken_from[end]
        with suppress(BlockingIOError):  # nothing there after all
            if taken.wants:
                taken.take(due)
                heapq.heappush(self._due, (due, next(self._number), connection, taken.sink))

    def _end(self, connection: DelayedConnection, *, cut: bool) -> None:
        for end in connection.ends:
            self._watch(end, 0, None)
        self._connections.discard(connection)
        connection.close(cut=cut)

    def _watch_all(self) -> None:
        if self._listener.fileno() >= 0:
            self._watch(self._listener, 0 if self._stalled else selectors.EVENT_READ, self._accept)
        for connection in self._connections:
            self._watch_ends(connection)

    def _watch_ends(self, connection: DelayedConnection) -> None:
        for end in connection.ends:
            events = selectors.EVENT_READ if connection.taken_from[end].wants else 0
            events |= selectors.EVENT_WRITE if connection.given_to[end].blocked else 0
            self._watch(end, 0 if self._stalled else events, partial(self._move, connection, end))

    def _watch(self, one: socket.socket, events: int, then: Callable[[int], None] | None) -> None:
        """Have `then` called for these events of a socket from now on."""
        known = self._selector.get_map().get(one)
        if known is None and events:
            self._selector.register(one, events, then)
        elif known is not None and not events:
            self._selector.unregister(one)
        elif known is not None and known.events != events:
            self._selector.modify(one, events, then)


def _listening(address: Address) -> socket.socket:
    try:
        found = socket.create_server(address, backlog=1024)
    except OSError as error:
        why = os.strerror(error.errno or 0)  # the error's own text names the address again
        raise AcrcError(f"cannot listen at {address[0]}:{address[1]}: {why}") from None
    found.setblocking(False)
    return found
