"""Rewriting of recordings with changes and valid seals."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import msgspec

from actors.runtime.failure import FailureNote
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Entry, Note, Recorder, read_recording

Change = Callable[[Entry | Note], Entry | Note | None]
KINDS: dict[str, type[msgspec.Struct]] = {"run": RunNote, "final": FinalNote, "failure": FailureNote}


class Anything(msgspec.Struct):
    """A note of any form."""

    json: str


def forge(path: Path, change: Change) -> None:
    """Rewrite a recording; `change` returns the replacement of an item, or None to drop it."""
    items = [changed for item in read_recording(path) if (changed := change(item)) is not None]
    path.unlink()
    with Recorder(path, 100_000) as recorder:
        for item in items:
            if isinstance(item, Note):
                recorder.note(item.name, msgspec.json.decode(item.json, type=KINDS[item.name]))
            elif item.direction == "in":
                assert item.payload is not None
                recorder.received(item.key, item.step, item.sequence, item.payload)
            else:
                payload = item.payload if item.payload is not None else bytes(1000)
                recorder.sent(item.key, item.step, item.sequence, payload, item.sha256)


def with_payload(entry: Entry, payload: bytes) -> Entry:
    return entry._replace(payload=payload, sha256=hashlib.sha256(payload).digest())
