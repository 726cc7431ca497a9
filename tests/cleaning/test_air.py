"""What a cleaning robot publishes fits the radio: one frame, or two with all that it may have adopted."""

import numpy as np

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import FRAME_DATA_LIMIT
from actors.robot.ports import Start, View
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.chapter import behaviour
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters
from cleaning.place import Claim, Duty
from deeco.fragments import CHECKSUM, HEADER, Fragmenter
from deeco.packet import KnowledgePacket, Version, pack
from deeco.schema import RoleBook

LONGEST = Duty("r500", 999, Point(-123.456, 123.456), 2000)
"""More than any scenario has."""


def packet(robot: AdaptiveCleaningRobot) -> bytes:
    book = RoleBook([Cleaner])
    return pack(KnowledgePacket(robot.id, Version(3, 100_000), 3, book.pack(robot)))


def robot(adopted: int, destination: Duty | None = LONGEST) -> AdaptiveCleaningRobot:
    claims = tuple(Claim("r500", 999 - number, 2000) for number in range(adopted))
    return AdaptiveCleaningRobot(
        id="r500",
        position=LONGEST.point,
        state=State.BLOCKED,
        destination=destination,
        former=destination if adopted else None,
        adopted=claims,
    )


def test_with_nothing_adopted_one_frame() -> None:
    data = packet(robot(0))
    assert len(data) <= 100
    (frame,) = Fragmenter(1).frames([data])
    assert len(frame) == len(data) + HEADER.size + CHECKSUM.size <= FRAME_DATA_LIMIT


def test_with_ten_adopted_two_frames() -> None:
    assert AdaptationParameters().most_adopted == 10
    frames = Fragmenter(1).frames([packet(robot(10))])
    assert len(frames) == 2 and all(len(frame) <= FRAME_DATA_LIMIT for frame in frames)


def test_what_the_strategy_itself_sends_first_is_one_frame_a_second() -> None:
    start = Start("r500", 500, 0, Pose(1.0, 2.0, 0.0), (LONGEST.point,) * 10, np.random.default_rng(1))
    hosted = behaviour(start)
    sent = [
        frame
        for step in range(50)
        for frame in hosted.advance(
            View(Instant(step * 100_000), start.pose, False, None, ()), Instant((step + 1) * 100_000)
        ).frames
    ]
    assert len(sent) == 5 and all(len(frame.data) <= FRAME_DATA_LIMIT for frame in sent)
