"""Recordings: what one process received, sent and noted, in an append-only MCAP file with checksums."""

from actors.runtime.recording.format import (
    LARGE,
    LARGEST_RECORD,
    Direction,
    Entry,
    Note,
    RecordingError,
    UnwritableError,
)
from actors.runtime.recording.reader import RecordingReader, decode_note, read_notes, read_recording
from actors.runtime.recording.recorder import Journal, NullJournal, Recorder

__all__ = [
    "LARGE",
    "LARGEST_RECORD",
    "Direction",
    "Entry",
    "Journal",
    "Note",
    "NullJournal",
    "Recorder",
    "RecordingError",
    "RecordingReader",
    "UnwritableError",
    "decode_note",
    "read_notes",
    "read_recording",
]
