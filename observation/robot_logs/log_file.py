"""The entries of a log as one MCAP file, in order of time. The same entries give the same bytes."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from observation.robot_logs.contents import KINDS, LATCHED, Content, Entry, Form, last_part

_CHUNK: Final = 4 << 20
"""Bytes that a reader must read at once; so many are in memory here."""


def write(path: Path, form: Form, entries: Iterable[Entry]) -> Counter[str]:
    """Write a file over what is there: how many messages each topic has. OSError as for any file."""
    counts = Counter[str]()
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.NONE, enable_data_crcs=True)
        writer.start(profile=form.profile, library="acrc")
        for name, about in form.about.items():
            writer.add_metadata(name, about)
        schemas: dict[type[Content], int] = {}
        channels: dict[str, int] = {}
        for one in entries:
            if one.topic not in channels:
                channels[one.topic] = _channel(writer, form, one.topic, schemas)
            data = one.content if isinstance(one.content, bytes) else form.encode(one.content, one.stamp)
            logged, sequence = one.logged * 1000, counts[one.topic]
            writer.add_message(channels[one.topic], logged, data, one.stamp * 1000, sequence)
            counts[one.topic] += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _channel(writer: Writer, form: Form, topic: str, schemas: dict[type[Content], int]) -> int:
    part = last_part(topic)
    kind = KINDS[part]
    if kind not in schemas:
        name, encoding, data = form.schema(kind)
        schemas[kind] = writer.register_schema(name, encoding, data)
    about = form.channel(latched=part in LATCHED)
    return int(writer.register_channel(topic, form.encoding, schemas[kind], about))
