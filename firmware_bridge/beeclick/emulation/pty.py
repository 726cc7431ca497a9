"""Runs emulated boards on pseudo-terminals, in real time, until the process is told to stop."""

import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Final

from actors.instant import Instant
from firmware_bridge.beeclick.emulation.emulated_medium import EmulatedMedium, advance
from firmware_bridge.pseudo_terminal import PseudoTerminal

_ROUND_S: Final = 0.001
"""Longest wait for bytes from a host, s."""


def serve(medium: EmulatedMedium, links: Sequence[Path]) -> None:
    """Be the medium's boards at those paths until SIGTERM or SIGINT. Raises LinkError."""
    stopped = False

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with ExitStack() as stack:
            lines = [stack.enter_context(PseudoTerminal(link)) for link in links]
            sys.stdout.write(f"boards at {', '.join(map(str, links))}; stop with Ctrl+C\n")
            sys.stdout.flush()
            begun = time.monotonic_ns()
            while not stopped:
                time.sleep(_ROUND_S)
                exchange(medium, lines, Instant((time.monotonic_ns() - begun) // 1000))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def exchange(medium: EmulatedMedium, lines: Sequence[PseudoTerminal], now: Instant) -> None:
    """Let the boards take and give on their lines what they have taken and given by `now`."""
    advance(medium, now)
    for board, line in zip(medium.boards, lines, strict=True):
        if data := line.read(0.0):
            board.take(now, data)
        line.write(board.run(now))
