"""The parsers of what comes over a robot's serial lines."""

from collections.abc import Callable, Iterator
from contextlib import suppress

from firmware_bridge.beeclick import answers, commands, sentence
from firmware_bridge.beeclick.answers import PacketSent, ReceivedPacket, Synchronised
from firmware_bridge.beeclick.reader import Reader
from firmware_bridge.beeclick.wire import NoiseError
from firmware_bridge.kobuki import frame
from firmware_bridge.kobuki.packets import UDID, BaseControl, Inertial
from firmware_bridge.kobuki.wire import (
    MalformedError,
    decode_commands,
    decode_feedback,
    encode_command,
    encode_feedback,
)
from firmware_bridge.range_sensors.rplidar_wire import Sample, SampleReader

Made = tuple[str, tuple[bytes, ...], Callable[[bytes], object]]
"""A parser's name, its seeds, and what reads bytes; noise on a wire is no error there."""


def device_parsers() -> Iterator[Made]:
    """Of the radio board, the base and the lidar; a depth image is an array of a fixed size."""
    said = answers.encode(Synchronised()) + b"".join(
        answers.encode(ReceivedPacket(1, 2, 30, 200, 7, bytes(range(n))))
        + answers.encode(PacketSent(n, True))
        for n in range(10)
    )
    yield "board's answers", (said,), _answers
    ordered = (commands.encode(commands.SendPacket(3, b"hello")), commands.encode(commands.SetChannel(4)))
    yield "board's commands", ordered, _noisy(commands.decode)
    yield (
        "board's sentence",
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",),
        (sentence.parse),
    )
    payload = encode_feedback(Inertial(5, -7)) + encode_feedback(UDID((1, 2, 3)))
    yield "base's frames", (frame.encode(payload) * 4,), frame.FrameReader(decode_feedback).take
    yield "base's packets", (payload,), _noisy(decode_feedback)
    yield "base's commands", (encode_command(BaseControl(100, 0)),), _noisy(decode_commands)
    turn = b"".join(Sample(angle == 0, 20, angle * 64, 4000).encode() for angle in range(360))
    yield "lidar's samples", (turn,), SampleReader().take


def _noisy(decode: Callable[[bytes], object]) -> Callable[[bytes], object]:
    def parse(data: bytes) -> None:
        with suppress(NoiseError, MalformedError):
            decode(data)

    return parse


def _answers(data: bytes) -> None:
    reader = Reader()
    reader.feed(data)
    while reader.next(True, (1, 2, 3)) is not None:
        pass
