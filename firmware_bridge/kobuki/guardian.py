"""Guardian process of a Kobuki: sends stop commands until the wheels stand if the base process fails.

`python -I -S guardian.py beside CHANNEL PORT` is started by a base (firmware_bridge.onboard.vehicle), shares
its port, and echoes its heartbeats on the descriptor CHANNEL. End of file: the base has exited, stop at once.
No heartbeat for HEARTBEAT_TIMEOUT_S: stop until heartbeats return; none for HUNG_S: kill the base, which its
supervisor restarts. `python -I -S guardian.py alone PORT` opens the port itself, after all processes were
killed.

For a fast start it imports little of the standard library. It needs neither disk nor log, and ignores all
signals except SIGKILL until the wheels stand.
"""

import fcntl
import os
import select
import signal
import socket
import sys
import termios
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, Protocol

HEARTBEAT_TIMEOUT_S: Final = 0.15
"""Timeout of heartbeats after which stop is sent; our choice: seven cycles of the base's event loop."""
HUNG_S: Final = 5.0
"""Timeout of heartbeats after which the base is killed; our choice: it stands for most of that time."""
PERIOD_S: Final = 0.02
"""Interval of stop commands; that of a base's feedback."""
LIMIT_S: Final = 10.0
"""Maximum duration of stop commands if no standstill is detected; own choice."""
STOP: Final = bytes.fromhex("aa 55 06 01 04 00 00 00 00 03")
"""Base control with speed 0, radius 0; a test compares it with firmware_bridge.kobuki.kobuki_packets."""
NOT_READY: Final = b"n"
"""Answer to a heartbeat if stop cannot be sent at present."""
_HEADER: Final = b"\xaa\x55"
_BASIC: Final = b"\x01\x0f"
"""ID and length of the first packet of a feedback."""
_WINDOW: Final = 6
"""Number of feedbacks for detecting standstill, 0.1 s."""
_STILL: Final = 2
"""Maximum change of encoder ticks of a standing wheel within the window."""


class Standstill:
    """Detector of standstill from a Kobuki's feedback."""

    def __init__(self) -> None:
        self._pending = b""
        self._ticks: deque[tuple[int, int, int]] = deque(maxlen=_WINDOW)

    @property
    def is_reached(self) -> bool:
        """True if neither wheel has turned during a full window of feedbacks."""
        if len(self._ticks) < _WINDOW:
            return False
        _, left, right = self._ticks[0]
        return all(
            max(_counter_distance(left, wheels[0]), _counter_distance(right, wheels[1])) <= _STILL
            for _, *wheels in self._ticks
        )

    def take(self, data: bytes) -> None:
        """Process bytes from the base, which may contain noise."""
        pending = (self._pending + data)[-4096:]
        at = pending.find(_HEADER)
        while 0 <= at <= len(pending) - 4:
            end = at + 3 + pending[at + 2]
            if len(pending) <= end:
                break
            if not self._frame(pending[at + 2 : end + 1]):
                end = at  # not a frame: another may begin within
            at = pending.find(_HEADER, end + 1)
        self._pending = pending[at:] if at >= 0 else pending[-1:]

    def _frame(self, body: bytes) -> bool:
        """Process length, payload and checksum; return False for a wrong checksum."""
        check = 0
        for byte in body:
            check ^= byte
        if check or body[1:3] != _BASIC or len(body) < 12:
            return check == 0
        stamp, left, right = (int.from_bytes(body[i : i + 2], "little") for i in (3, 8, 10))
        if not self._ticks or self._ticks[-1][0] != stamp:
            self._ticks.append((stamp, left, right))
        return True


class StopHandler(Protocol):
    """Sender of stop commands to a base, and detector of its standstill."""

    @property
    def is_ready(self) -> bool:
        """True if there is a connection to send stop to."""

    @property
    def is_standing(self) -> bool:
        """True if the wheels have stood since `reset`."""

    def reset(self) -> None:
        """Forget what was received from the base."""

    def take(self, message: bytes, descriptors: Sequence[int]) -> bytes:
        """Process a heartbeat or another message of the base process; return its answer."""

    def send(self) -> bool:
        """Send one stop command and receive feedback; return False if the connection is lost."""

    def close(self) -> None:
        """Close the connection."""


class SerialStop:
    """Sender of stop commands to a Kobuki's port."""

    def __init__(self, port: int | None = None) -> None:
        self._port = port
        self._standstill = Standstill()

    @property
    def is_ready(self) -> bool:
        """True if there is a port."""
        return self._port is not None

    @property
    def is_standing(self) -> bool:
        """True if the wheels have stood since `reset`."""
        return self._standstill.is_reached

    def reset(self) -> None:
        """Forget the feedback received."""
        self._standstill = Standstill()

    def take(self, message: bytes, descriptors: Sequence[int]) -> bytes:
        """Take the port's descriptor, or close the port for the message `c`; return the message."""
        if descriptors or message[:1] == b"c":
            self.close()
            self._port = descriptors[0] if descriptors else None
        return message

    def send(self) -> bool:
        """Send one stop command and read feedback; return False if the port is lost."""
        if self._port is None:
            return False
        try:
            with suppress(BlockingIOError):
                os.write(self._port, STOP)
            with suppress(BlockingIOError):
                self._standstill.take(os.read(self._port, 4096))
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            os.close(self._port)
            self._port = None


def stop_until_standstill(sender: StopHandler, limit_s: float = LIMIT_S) -> str:
    """Send stop commands until standstill, loss of the port, or `limit_s`; return the result, in words."""
    deadline, said = time.monotonic() + limit_s, 0
    while time.monotonic() < deadline:
        if not sender.send():
            return f"sent stop {said} times, until the port was lost"
        said += 1
        if sender.is_standing:
            return f"sent stop {said} times, until the wheels stood"
        time.sleep(PERIOD_S)
    return f"sent stop {said} times, but no standstill was detected: the base may still be driving"


class BaseWatchdog:
    """Watchdog of the base process at the other end of `channel`."""

    def __init__(self, channel: socket.socket, kill: Callable[[], None], sender: StopHandler) -> None:
        """`kill`: kills the base process."""
        self._channel = channel
        self._kill = kill
        self._sender = sender
        self._is_stopping = False
        """False while heartbeats arrive."""
        self._heartbeat_s = time.monotonic()

    def run(self) -> str:
        """Run until the base has exited and the wheels stand; return the result, in words."""
        while True:
            remaining_s = HEARTBEAT_TIMEOUT_S - (time.monotonic() - self._heartbeat_s)
            if select.select(
                [self._channel], [], [], PERIOD_S if self._is_stopping else max(remaining_s, 0.0)
            )[0]:
                if not self._receive():
                    break
            else:
                self._send_stop()
        return stop_until_standstill(self._sender) if self._sender.is_ready else "no port to send stop to"

    def _receive(self) -> bool:
        """Handle a message of the base; return False at end of file."""
        try:
            message, descriptors, _, _ = socket.recv_fds(self._channel, 16, 1)
        except OSError:
            return False
        if not message:
            return False
        answer = self._sender.take(message, descriptors)
        self._heartbeat_s, self._is_stopping = time.monotonic(), False
        self._sender.reset()
        with suppress(OSError):
            self._channel.send(answer, socket.MSG_DONTWAIT)
        return True

    def _send_stop(self) -> None:
        """Send stop in place of the silent base; kill it after HUNG_S."""
        self._is_stopping = True
        self._sender.send()
        if time.monotonic() - self._heartbeat_s > HUNG_S:
            self._kill()


def open_port(path: str) -> int:
    """Open the port with the settings of a Kobuki. Raises OSError."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    with suppress(OSError):  # another process may use the port, too
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with suppress(termios.error):  # a pseudo-terminal may refuse
        speed = termios.B115200
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        special = termios.tcgetattr(port)[6]
        termios.tcsetattr(port, termios.TCSANOW, [0, 0, control, 0, speed, speed, special])
    return port


def main(argv: Sequence[str]) -> int:
    """Run the guardian; return the exit code: 0 unless the wheels may still turn."""
    ignore_signals()
    if argv[0] == "beside":
        said = watch_parent(int(argv[1]), SerialStop())
    else:
        try:
            said = stop_until_standstill(SerialStop(open_port(argv[1])))
        except OSError as error:
            said = f"stop cannot be sent: {error.strerror}"
    return report(argv[-1], said)


def ignore_signals() -> None:
    """Ignore all signals but SIGKILL."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)


def watch_parent(channel: int, sender: StopHandler) -> str:
    """Guard the base process, which is the parent process, on a descriptor; return the result, in words."""
    base = os.getppid()

    def kill() -> None:
        if os.getppid() == base:
            os.kill(base, signal.SIGKILL)

    return BaseWatchdog(socket.socket(fileno=channel), kill, sender).run()


def report(name: str, said: str) -> int:
    """Write the result for a base to the log; return the exit code."""
    with suppress(OSError):
        os.write(1, f"{name}: {said}\n".encode())
    return 1 if "may still" in said or "cannot be sent" in said else 0


def _counter_distance(one: int, other: int) -> int:
    """Return the distance of two 16-bit counters that wrap."""
    return min((one - other) & 0xFFFF, (other - one) & 0xFFFF)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
