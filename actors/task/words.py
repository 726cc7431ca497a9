"""What robots say of their task: parts of the message `Drive`."""

from typing import Final, Protocol

from actors.topic import MessagePart

REASON_LIMIT: Final = 100
"""Characters of the reason for which a place is given up."""


class PlaceKey(MessagePart, frozen=True):
    """Names a place to be cleaned."""

    owner: str
    """The robot that the place was given to."""
    place: int
    """Its index in the owner's list, which grows where places come while the run goes on."""


class PlaceReport(MessagePart, frozen=True):
    """The robot holds that it has visited a place to be cleaned."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int


class PlaceGivenUp(MessagePart, frozen=True):
    """The robot holds that nobody should try for a place any more."""

    owner: str
    place: int
    """As in PlaceKey."""
    instant: int
    reason: str
    """For people; at most REASON_LIMIT characters."""


class TaskWords(Protocol):
    """What a robot says of its task in one step: part of a Drive, and of the decision that it comes from."""

    @property
    def reports(self) -> tuple[PlaceReport, ...]:
        """Places reported as visited."""

    @property
    def given_up(self) -> tuple[PlaceGivenUp, ...]:
        """Places given up."""

    @property
    def route(self) -> tuple[PlaceKey, ...] | None:
        """Where it still means to go; None: as it last said."""
