"""When the next SYNC may go to a board that has not answered, so that its ring of commands never runs over.

A board that is held up keeps what it is told, in a ring of seven; one that is wedged keeps it for ever. While
there is room a SYNC is sent often. After that it depends on what comes unasked: nothing, noise, or messages
as they should be, for then the board lives and does not listen, and only a reset by hand helps.
"""

from actors.instant import Duration, Instant
from firmware_bridge.beeclick.parameters import BeeClickParameters


class SendingPace:
    """What has gone to the board since it answered last, and what has come."""

    def __init__(self, parameters: BeeClickParameters) -> None:
        self._p = parameters
        self.last: int = -parameters.sync_interval
        """When the last SYNC was sent."""
        self._unheard = 0
        """SYNCs since the last byte came."""
        self._unasked = 0
        """Messages since the last answer."""
        self.unanswered = 0
        """Commands since the last answer, of which none has had one."""

    def connected(self, now: Instant) -> None:
        """Another connection, perhaps another board: a SYNC may be sent at once."""
        self.last = now - self._p.sync_interval
        self._unheard = self._unasked = self.unanswered = 0

    def asked(self) -> None:
        """A command has been sent."""
        self.unanswered += 1

    def synchronising(self, now: Instant) -> None:
        """A SYNC has been sent."""
        self.asked()
        self.last = now
        self._unheard += 1

    def heard(self) -> None:
        """Bytes have come."""
        self._unheard = 0

    def told(self) -> None:
        """The board has said something unasked that makes sense."""
        self._unasked += 1

    def answered(self, left: int) -> None:
        """A command has been answered, and of those behind it so many have not."""
        self.unanswered, self._unasked = left, 0

    @property
    def has_room(self) -> bool:
        """True if the board can take another command, whatever holds it up."""
        return self.unanswered < self._p.ring

    def due(self, searching: bool) -> Instant:
        """When the next SYNC may be sent. `searching`: what comes makes no sense."""
        return Instant(self.last + self._pause(searching))

    def _pause(self, searching: bool) -> Duration:
        p = self._p
        if self.has_room:
            return p.sync_interval if self._unheard < p.quick_syncs else p.slow_sync_interval
        if self.unanswered == p.ring:  # the board's own has room for one more
            return p.slow_sync_interval
        if self._unasked > 1 and not searching:
            return p.deaf_sync_interval
        if self._unheard:
            return p.slow_sync_interval
        return p.noisy_sync_interval if searching else p.sync_interval
