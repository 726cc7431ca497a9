"""Recorded outcomes of radio frames and of their copies, as rows and as arrays."""

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Flags, Floats, Int64s, Records
from actors.messages import TOO_WEAK, FrameOutcome, FrameOutcomes
from actors.radio.medium.state import Outcome
from actors.runtime.errors import AcrcError

LOSSES: Final = tuple(
    one for one in Outcome if one not in (Outcome.HEARD, Outcome.FILTERED, Outcome.NOT_COUNTED)
)
"""Reasons for the loss of a copy."""
_LISTED: Final = np.dtype([("receiver", "<u2"), ("outcome", "u1"), ("tenths", "<i2")])


class FrameOutcomesError(AcrcError):
    """Invalid outcomes of frames."""


def listed_copies(frame: FrameOutcome, robots: int) -> Records:
    """Return the listed copies of a frame: receiver number, outcome, and strength, 0.1 dBm.

    Raises FrameOutcomesError for invalid bytes.
    """
    parts = (frame.receivers, frame.outcomes, frame.strengths)
    count = len(frame.outcomes)
    if [len(part) for part in parts] != [2 * count, count, 2 * count] or not 0 <= frame.sender < robots:
        raise FrameOutcomesError(f"frame {frame.tag} of robot {frame.sender}: copies differ in length")
    listed = np.zeros(count, _LISTED)
    for name, part in zip(_LISTED.names or (), parts, strict=True):
        listed[name] = np.frombuffer(part, _LISTED[name])
    if (listed["receiver"] >= robots).any() or (listed["outcome"] > max(Outcome)).any():
        raise FrameOutcomesError(f"frame {frame.tag} of robot {frame.sender}: unknown receiver or outcome")
    return listed


class FrameCopies(NamedTuple):
    """Copies of frames, by end of the frame; (n,) each."""

    seconds: Floats
    senders: Int64s
    """Indices of robots."""
    receivers: Int64s
    outcomes: Int64s
    """Values of `Outcome`."""

    def select(self, which: Flags) -> "FrameCopies":
        """Return the copies selected by a mask, (n,)."""
        return FrameCopies(*map(itemgetter(which), self))


NO_COPIES: Final = FrameCopies(np.zeros(0), *(np.zeros(0, np.int64) for _ in range(3)))


def frame_copies(messages: Sequence[FrameOutcomes], transceivers: Sequence[int]) -> FrameCopies:
    """Return the copies of all sent frames at active transceivers. Raises FrameOutcomesError.

    `transceivers`: index of the robot for each number that the radio uses.
    """
    sent = [frame for message in messages for frame in message.frames if frame.end == "sent"]
    outcomes = np.full((len(sent), len(transceivers)), Outcome.BELOW_SENSITIVITY, np.int64)
    for row, frame in enumerate(sent):
        listed = listed_copies(frame, len(transceivers))
        outcomes[row, frame.sender] = Outcome.NOT_COUNTED
        outcomes[row, listed["receiver"]] = listed["outcome"]
    rows, receivers = np.nonzero((outcomes != Outcome.NOT_COUNTED) & (outcomes != Outcome.FILTERED))
    seconds = np.array([frame.ended for frame in sent], np.float64) / 1e6
    senders, robots = np.array([frame.sender for frame in sent], np.int64), np.array(transceivers, np.int64)
    return FrameCopies(seconds[rows], robots[senders[rows]], robots[receivers], outcomes[rows, receivers])


def concatenate_copies(parts: Sequence[FrameCopies]) -> FrameCopies:
    """Concatenate the copies of several parts."""
    return FrameCopies(*map(np.concatenate, zip(*parts, strict=True)))


def outcome_rates(copies: FrameCopies, begin: float, bins: int, bin_s: float) -> Floats:
    """Return copies per second by outcome, (bins, outcomes), from `begin`, s; the last bin counts all later
    copies, too."""
    table = np.zeros((bins, len(Outcome)))
    rows = np.clip(((copies.seconds - begin) / bin_s).astype(np.int64), 0, bins - 1)
    np.add.at(table, (rows, copies.outcomes), 1)
    return table / bin_s


def outcome_name(outcome: Outcome) -> str:
    """Return the outcome in words, such as "half duplex"."""
    return outcome.name.lower().replace("_", " ")


class CopyRow(NamedTuple):
    """Outcome of a frame at one other robot."""

    robot: str
    outcome: str
    """A name of `Outcome` in lower case."""
    strength_dbm: float
    """-inf: too weak to be tracked."""


class FrameRow(NamedTuple):
    """Outcome of one frame that was handed to a transceiver."""

    robot: str
    tag: int
    """The sender's number of the frame, unique per robot."""
    handed: int
    """µs."""
    ended: int
    """End of the transmission, or when the frame was dropped, µs."""
    size: int
    """Payload, bytes."""
    end: str
    """`sent`, `access_failure` or `overflow`."""
    copies: tuple[CopyRow, ...]
    """One per other robot whose transceiver was on at the start; empty for a frame that was not sent."""


def frame_rows(robots: Sequence[str], messages: Iterable[FrameOutcomes]) -> list[FrameRow]:
    """Return all completed frames; `robots`: in the order of the radio. Raises FrameOutcomesError."""
    return [_row(frame, robots) for message in messages for frame in message.frames]


def _row(frame: FrameOutcome, robots: Sequence[str]) -> FrameRow:
    copies = tuple(_copies(frame, robots))
    return FrameRow(robots[frame.sender], frame.tag, frame.handed, frame.ended, frame.size, frame.end, copies)


def _copies(frame: FrameOutcome, robots: Sequence[str]) -> Iterator[CopyRow]:
    listed = listed_copies(frame, len(robots))
    known = {receiver: (Outcome(outcome), tenths) for receiver, outcome, tenths in listed.tolist()}
    if frame.end != "sent":
        return
    for number, robot in enumerate(robots):
        outcome, tenths = known.get(number, (Outcome.BELOW_SENSITIVITY, TOO_WEAK))
        if number != frame.sender and outcome is not Outcome.NOT_COUNTED:
            yield CopyRow(robot, outcome.name.lower(), -math.inf if tenths == TOO_WEAK else tenths / 10.0)
