"""Runs an emulated device on a pseudo-terminal, in real time, until the process is told to stop."""

import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Final, Protocol

from actors.instant import Instant
from actors.runtime.command_line import ArgumentParser
from firmware_bridge.pseudo_terminal import PseudoTerminal

_ROUND_S: Final = 0.002
"""Longest wait for bytes, s: as fine as the emulated device's own timing."""


class EmulatedDevice(Protocol):
    """A device without I/O."""

    def take(self, now: Instant, data: bytes) -> None:
        """Bytes from the driver, that end `now`."""

    def run(self, now: Instant) -> bytes:
        """Let time pass until `now`; the bytes that have left for the driver."""


def serve(device: EmulatedDevice, link: Path, what: str) -> None:
    """Be that device at the path `link` until SIGTERM or SIGINT. Raises AcrcError."""
    with PseudoTerminal(link) as line:

        def exchange(now: Callable[[], Instant]) -> None:
            data = line.read(_ROUND_S)
            instant = now()
            if data:
                device.take(instant, data)
            line.write(device.run(instant))

        run_until_stopped(f"{what} at {link}", exchange)


def run_until_stopped(what: str, exchange: Callable[[Callable[[], Instant]], None]) -> None:
    """Say that `what` is there, and call `exchange` again and again until SIGTERM or SIGINT.

    It is given the clock, which begins with the first call, and waits as long as a round may take.
    """
    stopped = False

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        sys.stdout.write(f"{what}; stop with Ctrl+C\n")
        sys.stdout.flush()
        begun = time.monotonic_ns()
        while not stopped:
            exchange(lambda: Instant((time.monotonic_ns() - begun) // 1000))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def link_parser(program: str, description: str) -> ArgumentParser:
    """A command line with `--link PATH`, whose errors are ArgumentErrors."""
    parser = ArgumentParser(prog=program, description=description)
    parser.add_argument(
        "--link",
        type=Path,
        required=True,
        metavar="PATH",
        help="where to put the link to the pseudo-terminal",
    )
    return parser
