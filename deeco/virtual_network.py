"""In-memory network with virtual time: nodes, or anything that advances like them, on a lossy medium.

    network = VirtualNetwork({"hall": hall, "fan": fan}, LossyMedium(loss=0.2))
    network.advance_until(lambda: network["fan"].knowledge("fan").level == 3, timeout=seconds(10))

Equal arguments give equal results. For tests of ensembles, and for simulations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random  # noqa: TID251  # Random.random() is equal on all machines
from typing import Final, Generic, Protocol, TypeVar

from deeco.errors import DefinitionError, ExecutionError
from deeco.instant import START, ZERO, Duration, Instant, check_duration, in_seconds, milliseconds
from deeco.link import Reception

_STEP: Final = milliseconds(100)


class Frame(Protocol):
    """A frame to send."""

    @property
    def instant(self) -> int:
        """Instant of transmission, µs."""

    @property
    def data(self) -> bytes:
        """Content."""


class Participant(Protocol):
    """A node, or another sender and receiver of frames."""

    def advance(self, until: Instant, inputs: Sequence[Reception], /) -> Sequence[Frame]:
        """Process received frames, advance to an instant, and return the frames to send."""


P = TypeVar("P", bound=Participant)
Reach = Callable[[str, str], float | None]
"""Signal strength of the first participant at the second, dBm; None: out of reach."""


@dataclass
class LossyMedium:
    """Broadcast medium without collisions; frames are lost and delayed by seeded draws.

    A frame arrives at the earliest in the step after its transmission.
    """

    loss: float = 0.0
    """Probability that a participant within reach does not receive a frame."""
    delay: tuple[Duration, Duration] = (ZERO, ZERO)
    """Least and greatest time from transmission to reception, µs."""
    reach: Reach = lambda sender, receiver: -60.0
    """Default: -60 dBm everywhere. A test may replace it at any time."""
    seed: int = 1
    sent: list[tuple[str, Frame]] = field(default_factory=list)
    """Sender and frame of all transmissions, by step and participant."""

    def __post_init__(self) -> None:
        if not 0 <= self.loss <= 1:
            raise DefinitionError(f"LossyMedium: loss={self.loss} must be a share from 0 to 1")
        self._draw = Random(self.seed).random
        self._in_flight: list[tuple[str, Reception]] = []

    def send(self, sender: str, frame: Frame, participants: Sequence[str]) -> None:
        """Send a frame to the other participants, whose addresses count from 1."""
        self.sent.append((sender, frame))
        least, greatest = self.delay
        for name in participants:
            rssi_dbm = None if name == sender else self.reach(sender, name)
            if rssi_dbm is not None and self._draw() >= self.loss:
                instant = Instant(frame.instant + least + int(self._draw() * (greatest - least + 1)))
                address = participants.index(sender) + 1
                self._in_flight.append((name, Reception(instant, address, frame.data, rssi_dbm)))

    def receive(self, name: str, before: Instant) -> list[Reception]:
        """Return and remove the frames that a participant received before an instant."""
        due = [one for one in self._in_flight if one[0] == name and one[1].instant < before]
        self._in_flight = [one for one in self._in_flight if one not in due]
        return [reception for _, reception in due]


class VirtualNetwork(Generic[P]):
    """Participants of one medium, by name, advanced together in virtual time."""

    def __init__(
        self,
        participants: Mapping[str, P],
        medium: LossyMedium | None = None,
        *,
        step: Duration = _STEP,
    ) -> None:
        """Start at 0; received frames take effect at the next multiple of `step`."""
        check_duration("VirtualNetwork: step", step)
        self.participants = participants
        self.medium = medium or LossyMedium()
        self.now = START
        """Start of the next step."""
        self._step = step

    def __getitem__(self, name: str) -> P:
        try:
            return self.participants[name]
        except KeyError:
            known = ", ".join(self.participants)
            raise ExecutionError(f"the network has no participant {name!r}; use one of {known}") from None

    def advance(self, duration: Duration) -> None:
        """Advance all participants by `duration`, rounded up to whole steps."""
        end = self.now + duration
        while self.now < end:
            begin, self.now = self.now, Instant(self.now + self._step)
            sent = [
                (name, frame)
                for name, one in self.participants.items()
                for frame in one.advance(self.now, self.medium.receive(name, begin))
            ]
            for name, frame in sent:
                self.medium.send(name, frame, [*self.participants])

    def advance_until(self, condition: Callable[[], bool], timeout: Duration) -> None:
        """Advance until the condition holds. Raises AssertionError after `timeout`."""
        end = self.now + timeout
        while not condition():
            if self.now >= end:
                raise AssertionError(f"the condition does not hold within {in_seconds(timeout):g} s")
            self.advance(self._step)
