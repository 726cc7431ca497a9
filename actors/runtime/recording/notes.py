"""What a process has noted of itself: the first record of its file, and the last one."""

from pathlib import Path
from typing import IO, TypeVar

from mcap.opcode import Opcode

from actors.runtime import typed_json
from actors.runtime.recording.form import HEAD, Note, RecordingError
from actors.runtime.recording.reading import FAULTS, noted, opened, read_recording
from actors.runtime.recording.summary import note_places

T = TypeVar("T")


def read_notes(path: Path) -> dict[str, str]:
    """The metadata records of a file by name; the last one where a name occurs twice.

    By the index at the file's end, and without one by reading all of it. Raises RecordingError.
    """
    with opened(path) as stream:
        try:
            return {note.name: note.json for note in _indexed(stream)}
        except FAULTS:
            pass  # the process died, or the end is damaged
    return {item.name: item.json for item in read_recording(path) if isinstance(item, Note)}


def decoded(path: Path, name: str, text: str, kind: type[T]) -> T:
    """A note's content; RecordingError if it is no `kind`, whoever wrote it."""
    try:
        return typed_json.decode(text, kind)
    except ValueError as error:
        raise RecordingError(
            f"{path}: its record {name!r} is not what it should be: {str(error)[:300]}"
        ) from None


def _indexed(stream: IO[bytes]) -> list[Note]:
    notes = []
    for place in list(note_places(stream)):
        stream.seek(place.offset)
        record = stream.read(place.length)
        if HEAD.unpack_from(record) != (Opcode.METADATA, len(record) - HEAD.size):
            raise ValueError("the index of its notes leads elsewhere")
        notes.append(noted(record[HEAD.size :]))
    return notes
