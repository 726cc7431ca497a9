"""What both directions of the board's serial line share: types, sizes, the pattern, and the two ways to fail.

Every message is a type byte and a body of a size that type and body tell; numbers are little-endian. There is
no delimiter, no checksum and no escape. Source: d3scomp/beeclickarm, TODQueue.h and TOHQueue.h.
"""

from typing import Final

from firmware_bridge.serial_port import BOARD

BAUD: Final = BOARD.baud
"""8 data bits, no parity, 1 stop bit, no flow control."""
BITS_PER_BYTE: Final = 10
"""On the line: start bit, 8 data bits, stop bit."""
SYNC_PATTERN: Final = b"\x00Hello there!"
"""The SYNC message in both directions, type byte included."""
NUMBER_END: Final = 1 << 32
"""Packet numbers are below this."""
LONGEST_COMMAND: Final = 6 + 255
"""Bytes that a board may believe to belong to one command: SEND_PACKET with the greatest length byte."""


class NoiseError(Exception):
    """Bytes that no board sends at this point; the text is the anomaly's name among the counters."""


def byte_time(count: int) -> int:
    """How long so many bytes in a row take on the line, µs, rounded up."""
    return -(-count * BITS_PER_BYTE * 1_000_000 // BAUD)


def bytes_in(duration: int) -> int:
    """How many bytes in a row are through after so many µs."""
    return max(duration, 0) * BAUD // (BITS_PER_BYTE * 1_000_000)
