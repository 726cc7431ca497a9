"""The entries of a log as one MCAP file, in order of time. The same entries give the same bytes."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from observation.robot_logs.contents import KINDS, LATCHED, Content, LogEntry, LogForm, last_part

_LATEST: Final = 2**31 * 1_000_000
"""Before this, µs, and from 0 on, every form can tell an instant."""
_CHUNK: Final = 4 << 20
"""Bytes that a reader must read at once; so many are in memory here."""


def write(path: Path, form: LogForm, entries: Iterable[LogEntry], left_out: Counter[str]) -> Counter[str]:
    """Write a file over what is there: how many messages each topic has. OSError as for any file.

    `left_out` counts by topic what is of no instant that a log can have.
    """
    counts = Counter[str]()
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.NONE, enable_data_crcs=True)
        writer.start(profile=form.profile, library="acrc")
        for name, about in form.about.items():
            writer.add_metadata(name, about)
        schemas: dict[type[Content], int] = {}
        channels: dict[str, int] = {}
        for one in entries:
            if not (0 <= one.logged < _LATEST and 0 <= one.stamp < _LATEST):
                left_out[one.topic] += 1
                continue
            if one.topic not in channels:
                channels[one.topic] = _channel(writer, form, one.topic, schemas)
            data = one.content if isinstance(one.content, bytes) else form.encode(one.content, one.stamp)
            logged, sequence = one.logged * 1000, counts[one.topic]
            writer.add_message(channels[one.topic], logged, data, one.stamp * 1000, sequence)
            counts[one.topic] += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _channel(writer: Writer, form: LogForm, topic: str, schemas: dict[type[Content], int]) -> int:
    part = last_part(topic)
    kind = KINDS[part]
    if kind not in schemas:
        name, encoding, data = form.schema(kind)
        schemas[kind] = writer.register_schema(name, encoding, data)
    about = form.channel(latched=part in LATCHED)
    return int(writer.register_channel(topic, form.encoding, schemas[kind], about))
