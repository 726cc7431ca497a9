"""Executes an actor again from a recording that is still being written, as far as that has got."""

import time
from collections import deque
from pathlib import Path
from typing import Self

from actors.runtime.bus.replay_bus import ReplayBus, ReplayError, topic_of
from actors.runtime.recording import Entry, Reading
from actors.runtime.recording.reading import opened
from observation.replay.record_replay import Again, explained, shell_of


class GrowingBus(ReplayBus):
    """Gives what came in once something that went out stands behind it: then all of its step is there."""

    def __init__(self, again: Again) -> None:
        super().__init__(again.path, again.recall, ())
        self._reading, self._stream = Reading(again.path), opened(again.path)
        self._waiting: list[Entry] = []
        self._early: deque[tuple[str, bytes]] = deque()
        """What was sent again before it was read that it had been sent."""

    @property
    def ended(self) -> bool:
        """The recording was closed, and all of it has been given."""
        return self._reading.whole and not self._inputs

    @property
    def waits(self) -> str:
        """The key that was recorded next; empty if nothing is there."""
        return self._inputs[0].key if self._inputs else ""

    def grow(self) -> None:
        """Read what has been written. Raises RecordingError; ReplayError where it is not what was sent."""
        for item in self._reading.more(self._stream):
            if isinstance(item, Entry) and item.direction == "in":
                self._waiting.append(item)
            elif isinstance(item, Entry):
                self._outputs.append(item)
                self._release()
        if self._reading.whole:
            self._release()
        while self._early and self._outputs:
            super().publish(*self._early.popleft())

    def _release(self) -> None:
        self._inputs.extend(self._waiting)
        self._waiting.clear()

    def publish(self, key: str, payload: bytes) -> None:
        """Compare with what was recorded, as soon as that is there."""
        if self._outputs or topic_of(key).is_telemetry:
            super().publish(key, payload)
        else:
            self._early.append((key, payload))

    def settle(self) -> None:
        """ReplayError if a recording that was closed has other messages than were sent again."""
        self.grow()
        if self._reading.whole:
            super().close()
            if self._early:
                key, _ = self._early[0]
                raise ReplayError(f"{self._path}: sends on {key}, where nothing more was recorded")

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


class GrowingReplay:
    """One actor, replayed; a context manager that closes its recording."""

    def __init__(self, again: Again) -> None:
        self._again = again
        self._bus = GrowingBus(again)
        self._shell = shell_of(again, self._bus)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    @property
    def path(self) -> Path:
        """The recording."""
        return self._again.path

    @property
    def ended(self) -> bool:
        """Nothing will follow: the actor has finished, or its recording was closed."""
        return self._shell.finished or self._bus.ended

    def advance(self, budget_s: float) -> bool:
        """Take the steps that have been recorded, for about so long; False: there were more.

        Raises ReplayError where the actor does otherwise than it did, RecordingError for a damaged file.
        """
        shell, bus, end = self._shell, self._bus, time.monotonic() + budget_s
        try:
            bus.grow()
            while not shell.finished:
                for address in shell.open_to():
                    while (delivery := bus.poll(address.topic)) is not None:
                        shell.deliver(delivery)
                awaited = shell.pump()
                if awaited is None:
                    if time.monotonic() > end:
                        return False
                    continue
                delivery = bus.poll(awaited.topic)
                if delivery is None:
                    return self._dry(awaited.topic.pattern)
                shell.deliver(delivery)
        except ReplayError as error:
            raise explained(error, self._again) from None
        return True

    def settle(self) -> None:
        """Once it has ended: ReplayError where a closed recording has more, or less, than was sent again."""
        try:
            self._bus.settle()
        except ReplayError as error:
            raise explained(error, self._again) from None

    def _dry(self, wanted: str) -> bool:
        """There is nothing for it to take; True."""
        if self._bus.waits:
            raise ReplayError(
                f"{self.path}: the actor waits for {wanted} where {self._bus.waits} was recorded"
            )
        return True
