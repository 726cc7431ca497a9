"""Runs emulated boards on pseudo-terminals, in real time, until the process is told to stop."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from actors.instant import Instant
from firmware_bridge.beeclick.emulation.air import EmulatedAir
from firmware_bridge.emulation import run_until_stopped
from firmware_bridge.pseudo_terminal import PseudoTerminal

_ROUND_S: Final = 0.001
"""Longest wait for bytes from a host, s."""


def serve(air: EmulatedAir, links: Sequence[Path]) -> None:
    """Be the air's boards at those paths until SIGTERM or SIGINT. Raises LinkError."""
    with ExitStack() as stack:
        lines = [stack.enter_context(PseudoTerminal(link)) for link in links]

        def wait_and_exchange(now: Callable[[], Instant]) -> None:
            time.sleep(_ROUND_S)
            exchange(air, lines, now())

        run_until_stopped(f"boards at {', '.join(map(str, links))}", wait_and_exchange)


def exchange(air: EmulatedAir, lines: Sequence[PseudoTerminal], now: Instant) -> None:
    """Let the boards take and give on their lines what they have taken and given by `now`."""
    air.advance(now)
    for board, line in zip(air.devices, lines, strict=True):
        if data := line.read(0.0):
            board.take(now, data)
        line.write(board.run(now))
