"""A whole swarm in one process: the same cores exchange the same encoded bytes, without any transport."""

from collections import deque
from collections.abc import Callable, Sequence

from actors.runtime.core import Address, Delivery
from actors.runtime.errors import AcrcError
from actors.runtime.shell import Shell
from actors.topic import Message, Topic


class MemoryBus:
    """Routes by exact key or by `*` in the place of the robot's id; delivery is immediate and in order."""

    def __init__(self) -> None:
        self._listeners: list[tuple[Address, Callable[[Delivery], None]]] = []
        self._routes: dict[str, list[tuple[Topic[Message], Callable[[Delivery], None]]]] = {}

    def listen(self, address: Address, deliver: Callable[[Delivery], None]) -> None:
        """Call `deliver` with every message on `address` from now on."""
        self._listeners.append((address, deliver))
        self._routes.clear()

    def leave(self, deliver: Callable[[Delivery], None]) -> None:
        """Forget a listener."""
        self._listeners = [entry for entry in self._listeners if entry[1] != deliver]
        self._routes.clear()

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`."""
        if key not in self._routes:
            self._routes[key] = [(a.topic, deliver) for a, deliver in self._listeners if _matches(a, key)]
        for topic, deliver in self._routes[key]:
            deliver(Delivery(topic, key, payload))


def _matches(address: Address, key: str) -> bool:
    if address.robot != "*":
        return address.key == key
    prefix, _, suffix = address.topic.pattern.partition("{id}")
    name = key[len(prefix) : len(key) - len(suffix)]
    return key.startswith(prefix) and key.endswith(suffix) and bool(name) and "/" not in name


def run_shells(shells: Sequence[Shell], before_pump: Callable[[Shell], None] = lambda shell: None) -> None:
    """Advance the shells in turn until all have finished.

    `shells` may grow while this runs. Raises AcrcError, naming who waits for what, if nobody can go on.
    """
    while True:
        advanced = False
        open_shells = 0
        for shell in tuple(shells):
            if shell.finished:
                continue
            open_shells += 1
            if shell.held_by is not None:
                continue
            before_pump(shell)
            while shell.pump() is None:
                advanced = True
                if shell.finished:
                    break
        if not open_shells:
            return
        if not advanced:
            raise AcrcError(_stalled(shells))


def _stalled(shells: Sequence[Shell]) -> str:
    waiting = deque(
        f"{shell.actor} (step {shell.core.step}) for {shell.awaited[0].key}"
        for shell in shells
        if not shell.finished and shell.awaited
    )
    return "nobody can go on: " + "; ".join(waiting) + " is awaited and never sent"
