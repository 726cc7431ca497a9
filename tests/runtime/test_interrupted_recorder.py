"""A signal that ends a process in the middle of its recorder leaves a file that is whole."""

import sys
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec

from actors.runtime.recording import Note, read_recording
from actors.runtime.recording import recorder as module
from actors.runtime.recording.recorder import Recorder

LINES = 3000
"""More statements than the recorder executes here."""


class Told(BaseException):
    """As SIGTERM has it: raised between two statements, wherever the process is."""


def interrupted(path: Path, at: int) -> bool:
    """Record some steps, ended before the statement with this number; False if there are not as many."""
    left = at

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal left
        if frame.f_code.co_filename != module.__file__ or frame.f_code.co_name == "__exit__":
            return None
        if event == "line":
            left -= 1
            if left == 0:
                sys.settrace(None)
                raise Told
        return trace

    try:
        with Recorder(path, 100_000) as recording:
            try:
                sys.settrace(trace)
                for step in range(3):
                    recording.received(
                        "some/in", step, step, b"\x04" + msgspec.msgpack.encode([step, bytes(300)])
                    )
                    recording.sent("some/out", step, step, b"t" * 5000)
                    recording.flush()
            finally:
                sys.settrace(None)
    except Told:
        return True
    return False


def test_wherever_it_is_ended_what_is_recorded_is_whole_and_from_the_beginning(tmp_path: Path) -> None:
    ends = 0
    whole = tmp_path / "whole.mcap"
    assert not interrupted(whole, LINES)
    items = [(one.key, one.step) for one in read_recording(whole) if not isinstance(one, Note)]
    assert len(items) == 6
    for at in range(1, LINES):
        path = tmp_path / f"{at}.mcap"
        if not interrupted(path, at):
            break
        ends += 1
        found = [(one.key, one.step) for one in read_recording(path) if not isinstance(one, Note)]
        assert found == items[: len(found)], f"ended before statement {at}"
    assert ends > 60
