"""The form of a recording, for those who write and those who read it.

Channel metadata `direction` is `in` or `out`; `sequence` counts the messages of one key and direction;
a channel whose messages are there in full has a schema that names their fields (`description`);
`log_time` is the instant of the message's step, ns. A channel with message encoding `sha256` holds the step
as eight little-endian bytes and then the sha256 of the encoded message, which was too large to be kept twice
and which its receiver recorded in full; there it is packed, which the encodings `acrc-msgpack-scan` and
`acrc-msgpack-deflate` say (`packing`). Files from before that have none of these, and are read alike.
Metadata records: `run` first, then `final` or `failure` as the last one before the end of data; each has its
text as `json` and the text's CRC-32 as `crc32`.

The channel `seal` has the checksums: each of its messages holds the CRC-32 of the whole file before it and of
its own head, and the step of the last message before it (-1: there is none). What no seal vouches for does
not count.
"""

import struct
import zlib
from typing import Final, Literal, NamedTuple

from actors.runtime.errors import AcrcError

LARGE: Final = 256
"""A sender keeps its messages up to so many bytes in full."""
LARGEST_RECORD: Final = 16 * 1024 * 1024
"""Bytes; the world's last note on 1000 robots with 10 places each has less than 4 MB."""
UNSEALED: Final = 1024 * 1024
"""After so many bytes there is a seal, also within a step."""
MOST_CHANNELS: Final = 20_000
"""Three times what a world of 1000 robots has."""
MOST_NOTES: Final = 100
HEAD: Final = struct.Struct("<BQ")
"""Of every record: opcode, and the length of what follows."""
FIELDS: Final = struct.Struct("<HIQQ")
"""Of a message before its data: channel, sequence, log time, publish time."""
MESSAGE_HEAD: Final = struct.Struct(f"<{HEAD.format[1:]}{FIELDS.format[1:]}")
"""Both together: all of a message record before its data."""
SEAL: Final = struct.Struct("<Iq")
"""CRC-32 of the file up to it, with the seal's own head, fields and step (see `vouched`); and that step."""
SEALED: Final = struct.Struct(f"{MESSAGE_HEAD.format}q")
"""Of a seal, what its checksum covers: head and fields of its record, and the step."""
MESSAGES: Final = "acrc-msgpack"
SCANNED: Final = "acrc-msgpack-scan"
"""The same with its longest run of bytes, a scan, packed."""
DEFLATED: Final = "acrc-msgpack-deflate"
"""The same as a part of the file's one stream of deflate."""
HASHED: Final = "sha256"
SEALS: Final = "acrc-seal"

Direction = Literal["in", "out"]


class RecordingError(AcrcError):
    """A recording that cannot be written or read."""


class UnwritableError(RecordingError):
    """A recording of which the disk takes no more."""


class Entry(NamedTuple):
    """One recorded message; `payload` is None where only its hash was kept."""

    direction: Direction
    key: str
    step: int
    sequence: int
    payload: bytes | None
    sha256: bytes


class Note(NamedTuple):
    """One metadata record: its name and its content as JSON text."""

    name: str
    json: str


def vouched(crc: int, seal: bytes) -> int:
    """The CRC-32 that a seal gives, where that of the file before it is `crc`.

    `seal`: its own head, fields and step (`SEALED`), for nothing vouches for the last one of a file.
    """
    return zlib.crc32(seal, crc)
