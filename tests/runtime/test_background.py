"""A disk that is slow, full or dead holds up nobody, and what it has not taken is said."""

import errno
import io
import threading
import time
from pathlib import Path

import msgspec
import pytest

from actors.runtime.background import Background, BackgroundRecorder, Log
from actors.runtime.recording import Entry, Recorder, UnwritableError, read_recording


class Final(msgspec.Struct):
    said: str


def fill(recorder: Recorder) -> None:
    with recorder:
        recorder.note("run", Final("begin"))
        for step in range(50):
            payload = msgspec.msgpack.encode(["x", step])
            recorder.received("swarm/a", step, step, payload)
            recorder.sent("swarm/b", step, step, payload, b"h" * 32)
            recorder.flush()
        recorder.note("final", Final("end"))


def test_the_file_is_that_of_a_recorder_that_waits(tmp_path: Path) -> None:
    fill(Recorder(tmp_path / "waits.mcap", 100_000))
    fill(BackgroundRecorder(tmp_path / "later.mcap", 100_000))
    assert (tmp_path / "later.mcap").read_bytes() == (tmp_path / "waits.mcap").read_bytes()


def test_a_slow_disk_holds_up_nobody_and_a_full_one_is_said_in_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "base.mcap"
    slow, full = threading.Event(), UnwritableError(f"{path}: cannot be written: no space left on device")

    def flush(self: Recorder) -> None:
        slow.wait(10)
        raise full

    recorder = BackgroundRecorder(path, 100_000)
    monkeypatch.setattr(Recorder, "flush", flush)
    with recorder:
        begun = time.monotonic()
        for step in range(10):
            recorder.received("swarm/a", step, step, b"payload")
            recorder.flush()
        assert time.monotonic() - begun < 0.5
        slow.set()
    assert capsys.readouterr().err == (
        f"{path}: cannot be written: no space left on device; records are lost from here on\n"
        f"{path}: cannot be written: no space left on device; 10 records are missing\n"
    )


def test_what_does_not_fit_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Background, "LIMIT", 3)
    begun, stuck, done = threading.Event(), threading.Event(), []
    background = Background()

    def hang() -> None:
        begun.set()
        stuck.wait(10)

    background.do(hang)
    assert begun.wait(10)
    for number in range(5):
        background.do(lambda number=number: done.append(number))  # type: ignore[misc]
    assert background.dropped == 2
    assert not background.close(0.01)
    stuck.set()
    background._thread.join(10)
    assert done == [0, 1, 2]


def test_lines_are_written_in_their_order() -> None:
    lines: list[str] = []
    log = Log(lines.append)
    for number in range(3):
        log.say(f"line {number}")
    log.close()
    assert lines == ["line 0\n", "line 1\n", "line 2\n"]


def test_nothing_that_passed_is_dropped_while_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of it stays, also channels that begin meanwhile, and is there once the disk takes it."""
    path = tmp_path / "world.mcap"
    payload = b"v" + msgspec.msgpack.encode([1, bytes(100)])
    with Recorder(path, 100_000) as recorder:
        recorder.received("swarm/a", 1, 0, payload)
        recorder.flush()
        file = recorder._stream._file
        monkeypatch.setattr(recorder._stream, "_file", _Full())
        with pytest.raises(UnwritableError, match="no space left"):
            for number in range(1000):
                recorder.sent(f"swarm/{number}", 1, 0, payload)
        monkeypatch.setattr(recorder._stream, "_file", file)
    sent = [one for one in read_recording(path) if isinstance(one, Entry) and one.direction == "out"]
    assert [one.key for one in sent] == [f"swarm/{one}" for one in range(number + 1)]


class _Full:
    def write(self, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_what_is_recorded_goes_to_the_disk_also_within_a_step(tmp_path: Path) -> None:
    """A step may bring any number of messages, and only its end is flushed: a few KiB wait in memory."""
    path = tmp_path / "r1.mcap"
    with Recorder(path, 100_000) as recorder:
        for sequence in range(500):
            recorder.received("swarm/down/r1/received", 0, sequence, bytes(100))
            assert sequence * 100 < path.stat().st_size + 2 * io.DEFAULT_BUFFER_SIZE
