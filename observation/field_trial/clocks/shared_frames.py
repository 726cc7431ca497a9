"""Radio frames that several robots of a field trial have stamped, each known by its sender and its bytes."""

from collections.abc import Callable
from dataclasses import dataclass, field

from observation.field_trial.clocks.frame_stamps import Stamp, StampedFrame, StampKind
from observation.field_trial.recordings import FieldTrial
from observation.field_trial.robot_log import Moment, RobotLog

Stamping = Callable[[RobotLog, Moment, StampKind], Stamp]


@dataclass
class _Sightings:
    """Everything that is said of the frames of one sender with the same bytes."""

    sent: list[Stamp] = field(default_factory=list)
    handed: list[Stamp] = field(default_factory=list)
    heard: dict[str, list[Stamp]] = field(default_factory=dict)
    """By the robot that has heard it."""

    @property
    def is_unique(self) -> bool:
        """True if nobody has sent or heard two such frames."""
        return len(self.handed) <= 1 and all(len(stamps) == 1 for stamps in self.heard.values())


def shared_frames(trial: FieldTrial, stamp: Stamping) -> list[StampedFrame]:
    """The frames with stamps of at least two robots, in a fixed order, without those that might be mixed up.

    `stamp` makes a robot's word on a frame a stamp.
    """
    found: dict[tuple[int, bytes], _Sightings] = {}
    for log in trial.all_logs():
        identity = log.identity
        for sent in log.sent:
            sightings = found.setdefault((identity.address, sent.data), _Sightings())
            sightings.handed.append(stamp(log, sent.handed, StampKind.HANDED))
            if sent.sent is not None:
                sightings.sent.append(stamp(log, sent.sent, StampKind.SENT))
        for heard in log.heard:
            sightings = found.setdefault((heard.sender, heard.data), _Sightings())
            sightings.heard.setdefault(identity.id, []).append(stamp(log, heard.heard, StampKind.HEARD))
    return [
        frame
        for sightings in found.values()
        if sightings.is_unique and len((frame := _frame(sightings)).stamps) > 1
    ]


def _frame(sightings: _Sightings) -> StampedFrame:
    """The sender's best stamp and all others; one that was never confirmed has left all the same if heard."""
    heard = [stamp for stamps in sightings.heard.values() for stamp in stamps]
    handed = sightings.handed[0] if sightings.handed else None
    return StampedFrame((*(sightings.sent or sightings.handed), *heard), handed)
