"""Drives the core of a base or a bridge: waits for ports, mesh and clock at once, and tells the core."""

import select
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from actors.instant import Instant
from actors.runtime.bus.waking_bus import WakingBus
from actors.runtime.core import Core
from actors.runtime.shell import Shell


class Clock:
    """Microseconds since the Unix epoch that never go back, whatever becomes of the machine's clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> Instant:
        """The instant that it is."""
        return Instant((time.monotonic_ns() + self._ahead_ns) // 1000)

    def seconds_until(self, instant: Instant | None) -> float:
        """How long it is until then, s, at least 0; a second if there is no instant."""
        return 1.0 if instant is None else max(0.0, (instant - self.now()) / 1e6)


class TimedCore(Core, Protocol):
    """A core that is told the time, and which message comes next."""

    now: Instant

    def expect(self, key: str) -> None:
        """The next advance takes the message that has come on that key."""


class Devices(Protocol):
    """The ports beside the mesh."""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; called at least every `LONGEST_WAIT`."""

    @property
    def wake(self) -> Instant | None:
        """When to be served again, if nothing comes before."""


LONGEST_WAIT = 0.02
"""s; a Kobuki wants a command with each feedback, 50 a second."""


def conduct(
    shell: Shell,
    bus: WakingBus,
    core: TimedCore,
    devices: Devices,
    clock: Clock,
    wake: Callable[[], Instant | None],
    timely: Callable[[], bool],
) -> None:
    """Run until the core has finished.

    `wake`: when the core wants an advance without a message, if it says so by `timely`.
    """
    while not core.finished:
        due = [instant for instant in (wake(), devices.wake) if instant is not None]
        patience = min(LONGEST_WAIT, clock.seconds_until(min(due) if due else None))
        select.select([bus.fileno(), *devices.descriptors()], [], [], patience)
        core.now = clock.now()
        devices.serve(core.now)
        for delivery in bus.take():
            core.now = clock.now()
            core.expect(delivery.key)
            shell.deliver(delivery)
            shell.pump()
        core.now = clock.now()
        if not core.finished and timely():
            shell.pump()
