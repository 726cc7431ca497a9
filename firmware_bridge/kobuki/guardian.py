"""The last word to a Kobuki: a process that says stop until the wheels stand, whatever became of the base.

`python -I -S guardian.py beside CHANNEL PORT` is started by a base (firmware_bridge.onboard.vehicle)
and has the very port that the base has. CHANNEL is a descriptor of theirs: each pulse of the base comes back,
so that each knows that the other lives. Its end is the base's end, and means stop at once; no pulse for
PATIENCE_S means stop until there are pulses again; none for HUNG_S, and the base is killed, so that whoever
started it notices. `python -I -S guardian.py alone PORT` opens the port: for when all processes were killed.

Small, of the standard library's smallest parts, so that it is there before anything moves: it needs neither
disk nor log to say stop, and no signal but SIGKILL ends it before the wheels stand.
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
from typing import Final

PATIENCE_S: Final = 0.15
"""So long without a pulse, and stop is said; own choice: seven rounds of a base's loop."""
HUNG_S: Final = 5.0
"""So long without a pulse, and the base is killed; own choice: it has stood for most of that time."""
PERIOD_S: Final = 0.02
"""Stop is said so often, as often as a base gives feedback."""
LIMIT_S: Final = 10.0
"""So long stop is said to a base that cannot be heard to stand; own choice."""
STOP: Final = bytes.fromhex("aa 55 06 01 04 00 00 00 00 03")
"""Base control: speed 0, radius 0 (firmware_bridge.kobuki.wire and .wire, which a test holds it against)."""
_HEADER: Final = b"\xaa\x55"
_BASIC: Final = b"\x01\x0f"
"""Id and length of the packet that a feedback begins with."""
_WINDOW: Final = 6
"""Feedbacks, 0.1 s, ..."""
_STILL: Final = 2
"""... within which a wheel that stands may turn by so many ticks."""


class Standstill:
    """Hears from a Kobuki's feedback whether its wheels stand."""

    def __init__(self) -> None:
        self._pending = b""
        self._ticks: deque[tuple[int, int, int]] = deque(maxlen=_WINDOW)

    @property
    def reached(self) -> bool:
        """True if neither wheel has turned for a whole window of feedbacks."""
        if len(self._ticks) < _WINDOW:
            return False
        _, left, right = self._ticks[0]
        return all(
            max(_apart(left, wheels[0]), _apart(right, wheels[1])) <= _STILL for _, *wheels in self._ticks
        )

    def take(self, data: bytes) -> None:
        """Bytes from the base, whatever is in them."""
        pending = (self._pending + data)[-4096:]
        at = pending.find(_HEADER)
        while 0 <= at <= len(pending) - 4:
            end = at + 3 + pending[at + 2]
            if len(pending) <= end:
                break
            if not self._frame(pending[at + 2 : end + 1]):
                end = at  # no frame: another may begin within
            at = pending.find(_HEADER, end + 1)
        self._pending = pending[at:] if at >= 0 else pending[-1:]

    def _frame(self, body: bytes) -> bool:
        """Take in length, payload and checksum; False if they are none."""
        check = 0
        for byte in body:
            check ^= byte
        if check or body[1:3] != _BASIC or len(body) < 12:
            return check == 0
        stamp, left, right = (int.from_bytes(body[i : i + 2], "little") for i in (3, 8, 10))
        if not self._ticks or self._ticks[-1][0] != stamp:
            self._ticks.append((stamp, left, right))
        return True


def farewell(port: int, begun: Standstill | None = None, limit_s: float = LIMIT_S) -> str:
    """Say stop until the wheels stand, the port has gone, or for so long; what came of it, in a sentence."""
    heard = begun or Standstill()
    deadline, said = time.monotonic() + limit_s, 0
    while time.monotonic() < deadline:
        if not say_stop(port, heard):
            return f"stop was said {said} times, until the port had gone"
        said += 1
        if heard.reached:
            return f"stop was said {said} times, until the wheels stood"
        time.sleep(PERIOD_S)
    return f"stop was said {said} times, but the base was not heard to stand: it may still be driving"


def say_stop(port: int, heard: Standstill) -> bool:
    """Say it once, and hear what the base says; False if the port has gone."""
    try:
        with suppress(BlockingIOError):
            os.write(port, STOP)
        with suppress(BlockingIOError):
            heard.take(os.read(port, 4096))
    except OSError:
        return False
    return True


class BaseWatcher:
    """Watches over the base process at the other end of `channel`."""

    def __init__(self, channel: socket.socket, kill: Callable[[], None]) -> None:
        """`kill`: ends the base process."""
        self._channel = channel
        self._kill = kill
        self._port: int | None = None
        self._heard: Standstill | None = None
        """While the base does not speak."""
        self._alive = time.monotonic()

    def run(self) -> str:
        """Until the base has ended and the wheels stand; what came of it."""
        while True:
            patience = PATIENCE_S - (time.monotonic() - self._alive)
            if select.select([self._channel], [], [], PERIOD_S if self._heard else max(patience, 0.0))[0]:
                if not self._receive():
                    break
            else:
                self._stand_in()
        return "there is no port to say stop on" if self._port is None else farewell(self._port, self._heard)

    def _receive(self) -> bool:
        """One message: a pulse, or with a descriptor a port, or that the port was closed; False: the end."""
        try:
            message, ports, _, _ = socket.recv_fds(self._channel, 16, 1)
        except OSError:
            return False
        if not message:
            return False
        if ports or message[:1] == b"c":
            if self._port is not None:
                os.close(self._port)
            self._port = ports[0] if ports else None
        self._alive, self._heard = time.monotonic(), None
        with suppress(OSError):
            self._channel.send(message, socket.MSG_DONTWAIT)
        return True

    def _stand_in(self) -> None:
        """The base does not speak: stop."""
        self._heard = self._heard or Standstill()
        if self._port is not None:
            say_stop(self._port, self._heard)
        if time.monotonic() - self._alive > HUNG_S:
            self._kill()


def open_alone(path: str) -> int:
    """The port, set for a Kobuki. Raises OSError."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    with suppress(OSError):  # whoever else has it may go on: stop may be said by two
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with suppress(termios.error):  # a pseudo-terminal may refuse
        speed = termios.B115200
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        special = termios.tcgetattr(port)[6]
        termios.tcsetattr(port, termios.TCSANOW, [0, 0, control, 0, speed, speed, special])
    return port


def main(argv: Sequence[str]) -> int:
    """Have the last word; the exit code: 0 unless the wheels may still turn."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    if argv[0] == "beside":
        said = BaseWatcher(socket.socket(fileno=int(argv[1])), _killer(os.getppid())).run()
    else:
        try:
            said = farewell(open_alone(argv[1]))
        except OSError as error:
            said = f"stop cannot be said: {error.strerror}"
    with suppress(OSError):
        os.write(1, f"{argv[-1]}: {said}\n".encode())
    return 1 if "may still" in said or "cannot" in said else 0


def _killer(base: int) -> Callable[[], None]:
    def kill() -> None:
        if os.getppid() == base:
            os.kill(base, signal.SIGKILL)

    return kill


def _apart(one: int, other: int) -> int:
    """Of two counters that wrap."""
    return min((one - other) & 0xFFFF, (other - one) & 0xFFFF)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
