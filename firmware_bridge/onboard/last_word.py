"""The base's side of the process that has the last word to the Kobuki: firmware_bridge.kobuki.guardian."""

import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Protocol

from actors.instant import Duration, Instant, milliseconds, seconds
from firmware_bridge.kobuki import guardian

_PULSE: Final[Duration] = milliseconds(10)
"""The least time between two pulses."""
PATIENCE: Final[Duration] = milliseconds(150)
"""A pulse that has not come back for so long: the guardian does not watch. As it does the other way round."""
_HUNG: Final[Duration] = seconds(2)
"""After so long another guardian is started."""
_PAUSE: Final[Duration] = milliseconds(200)
"""Before it is, so that the base has said stop itself."""
_FAREWELL_S: Final = 1.0
"""How long it is waited for in the end; it goes on without that."""


class Port(Protocol):
    """What the guardian is given."""

    def fileno(self) -> int:
        """The descriptor."""


class LastWord:
    """One guardian after the other, if need be; nothing may move while none `holds` the port."""

    def __init__(
        self, name: str, start: Callable[[int, str], "subprocess.Popen[bytes]"] | None = None
    ) -> None:
        """`name`: of the port, for people. `start`: a guardian with that descriptor for its channel."""
        self._name = name
        self._start = start or start_guardian
        self._channel: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._given: Port | None = None
        """The port that the guardian was told of last."""
        self._number = 0
        """Of the last message that told of a port."""
        self._confirmed = False
        self._pulsed = self._begin_at = Instant(0)
        self._ended: list[subprocess.Popen[bytes]] = []
        self._waiting: Instant | None = None
        """Since when there is a pulse that has not come back."""
        self.started = 0
        """Guardians so far."""

    def serve(self, now: Instant, port: Port | None) -> None:
        """Let the guardian know that the base lives, and of the port it has; to be called all the time."""
        self._hear(now)
        if self._waiting is not None and now - self._waiting > _HUNG:
            self._end(now)
        if self._channel is None:
            if now < self._begin_at:
                return
            self._begin()
        if port is not self._given:
            self._give(now, port)
        elif now - self._pulsed >= _PULSE:
            self._send(now, b"p")

    def holds(self, now: Instant) -> bool:
        """True while the guardian lives, and has the port."""
        late = self._waiting is not None and now - self._waiting > PATIENCE
        return self._channel is not None and self._confirmed and self._given is not None and not late

    def close(self) -> None:
        """Leave the last word to the guardian, and wait until the wheels stand, if that is soon."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_FAREWELL_S)

    def _begin(self) -> None:
        self._ended = [process for process in self._ended if process.poll() is None]
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = self._start(theirs.fileno(), self._name)
        ours.setblocking(False)
        self._channel, self._given, self._waiting = ours, None, None
        self._confirmed = False
        self.started += 1

    def _end(self, now: Instant) -> None:
        """This guardian is of no use any more."""
        self._begin_at = Instant(now + _PAUSE)
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            self._process.kill()
            self._ended.append(self._process)
        self._channel = self._process = self._given = self._waiting = None
        self._confirmed = False

    def _give(self, now: Instant, port: Port | None) -> None:
        self._number = (self._number + 1) & 0xFF
        self._given, self._confirmed = port, False
        if port is None:
            self._send(now, b"c" + bytes((self._number,)))
        else:
            self._send(now, b"o" + bytes((self._number,)), [port.fileno()])

    def _send(self, now: Instant, message: bytes, ports: list[int] | None = None) -> None:
        assert self._channel is not None
        self._pulsed = now
        self._waiting = now if self._waiting is None else self._waiting
        try:
            socket.send_fds(self._channel, [message], ports or [])
        except BlockingIOError:
            if ports:
                self._given = None  # to be told again
        except OSError:
            self._end(now)

    def _hear(self, now: Instant) -> None:
        """What has come back."""
        while self._channel is not None:
            try:
                message = self._channel.recv(16)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self._end(now)
                return
            self._waiting = None
            if message == b"o" + bytes((self._number,)):
                self._confirmed = True


def start_guardian(channel: int, name: str) -> "subprocess.Popen[bytes]":
    """Start one, in a session of its own, with nothing to load but itself; it has our log."""
    return subprocess.Popen(
        [sys.executable, "-I", "-S", guardian.__file__, "beside", str(channel), name],
        pass_fds=(channel,),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        cwd="/",
    )
