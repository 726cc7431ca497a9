"""Recordings: what one process received, sent and noted, in an append-only MCAP file with checksums."""

from actors.runtime.recording.form import (
    LARGE,
    LARGEST_RECORD,
    Direction,
    Entry,
    Note,
    RecordingError,
    UnwritableError,
)
from actors.runtime.recording.reading import Reading, decoded, read_notes, read_recording
from actors.runtime.recording.recorder import Journal, Recorder, Unrecorded

__all__ = [
    "LARGE",
    "LARGEST_RECORD",
    "Direction",
    "Entry",
    "Journal",
    "Note",
    "Reading",
    "Recorder",
    "RecordingError",
    "Unrecorded",
    "UnwritableError",
    "decoded",
    "read_notes",
    "read_recording",
]
