"""The link between a transceiver and its robot's computer, which may be frozen."""

from actors.messages import RadioEvent
from actors.radio.frame_outcomes import FrameOutcomes


class Host:
    """Holds up to `buffer` events for a robot that does not step; what comes later is dropped and counted."""

    def __init__(self, buffer: int, outcomes: FrameOutcomes) -> None:
        self._buffer = buffer
        self._outcomes = outcomes
        self._held: list[RadioEvent] = []
        self._epoch: int | None = None

    def deliver(
        self, events: list[RadioEvent], powered: bool, stepping: bool, epoch: int = 0
    ) -> list[RadioEvent]:
        """What the robot is given now: all that is held and the new events if it steps, otherwise nothing.

        A robot without power is given nothing, and what was held for it is discarded and counted; so is in a
        new epoch what was held for the one before.
        """
        if epoch != self._epoch:
            self._outcomes.events("discarded", len(self._held))
            self._held, self._epoch = [], epoch
        if not powered:
            self._outcomes.events("discarded", len(self._held) + len(events))
            self._held = []
            return []
        if stepping:
            held, self._held = self._held, []
            return held + events if held else events
        room = self._buffer - len(self._held)
        self._held += events[:room]
        self._outcomes.events("dropped", len(events) - min(room, len(events)))
        return []
