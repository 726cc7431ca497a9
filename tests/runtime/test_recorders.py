"""A slow, full or failed disk blocks no process, and losses are reported."""

import errno
import io
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec
import pytest

from actors.runtime.background import BackgroundRecorder, BackgroundWorker
from actors.runtime.recording import Entry, Note, Recorder, UnwritableError, read_recording
from actors.runtime.recording import recorder as module
from tests.helpers import on_small_disk


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


def test_background_recorder_writes_the_same_file(tmp_path: Path) -> None:
    fill(Recorder(tmp_path / "waits.mcap", 100_000))
    fill(BackgroundRecorder(tmp_path / "later.mcap", 100_000))
    assert (tmp_path / "later.mcap").read_bytes() == (tmp_path / "waits.mcap").read_bytes()


def test_slow_disk_does_not_block_and_full_disk_is_reported(
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
        f"{path}: cannot be written: no space left on device; all further records are lost\n"
        f"{path}: cannot be written: no space left on device; 10 records lost\n"
    )


def test_dropped_tasks_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BackgroundWorker, "LIMIT", 3)
    begun, stuck, done = threading.Event(), threading.Event(), []
    background = BackgroundWorker()

    def hang() -> None:
        begun.set()
        stuck.wait(10)

    background.submit(hang)
    assert begun.wait(10)
    for number in range(5):
        background.submit(lambda number=number: done.append(number))  # type: ignore[misc]
    assert background.dropped == 2
    assert not background.close(0.01)
    stuck.set()
    background._thread.join(10)
    assert done == [0, 1, 2]


def test_a_full_disk_drops_no_accepted_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Channels and messages during the outage are kept and written later."""
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


def test_records_are_written_within_a_step(tmp_path: Path) -> None:
    """A step may have any number of messages; only its end is flushed, and a few KiB wait in memory."""
    path = tmp_path / "r1.mcap"
    with Recorder(path, 100_000) as recorder:
        for sequence in range(500):
            recorder.received("swarm/down/r1/received", 0, sequence, bytes(100))
            assert sequence * 100 < path.stat().st_size + 2 * io.DEFAULT_BUFFER_SIZE


ROOT = Path(__file__).parents[2]
PROGRAM = """
import errno, os, sys
from pathlib import Path
import msgspec
from actors.runtime.background import BackgroundRecorder, LossyRecorder
from actors.runtime.linux import create_log, redirect_output
from actors.runtime.recording import Note, Recorder, RecordingError, read_recording
from firmware_bridge.onboard import last_pose
from firmware_bridge.onboard.last_pose import LastPose

folder = Path(sys.argv[1])
out = os.fdopen(os.dup(1), "w")
def message(step): return b"v" + msgspec.msgpack.encode([step, bytes(100)])
def say(*words): print(*words, file=out, flush=True)

last_pose.write(folder / "r1.pose", LastPose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.5))
sys.excepthook = lambda kind, error, trace: say("failed", kind, error, trace.tb_lineno)
redirect_output(create_log(folder / "r1.log"))
recorders = {kind: kind(folder / f"{kind.__name__}.mcap", 100_000)
             for kind in (LossyRecorder, BackgroundRecorder, Recorder)}
for line in range(150):  # more than a log has room for in the beginning
    sys.stderr.write(f"{line:79}\\n")
sys.stderr.flush()
for step in range(3):
    for recorder in recorders.values():
        recorder.received("swarm/a", step, step, message(step))
        recorder.flush()
recorders[BackgroundRecorder]._background.close()
recorders[BackgroundRecorder]._background = type(recorders[BackgroundRecorder]._background)()

with (folder / "ballast").open("wb", buffering=0) as ballast:
    try:
        while True:
            ballast.write(bytes(4096))
    except OSError as error:
        say("full", error.errno == errno.ENOSPC)
for kind, recorder in recorders.items():
    try:
        with recorder:
            for step in range(3, 203):
                take = recorder.computed if step % 2 else recorder.received
                take("swarm/a", step, step, message(step))
                recorder.flush()
        say(kind.__name__, getattr(recorder, "dropped", recorder.lost))
    except RecordingError as error:
        say(kind.__name__, error)
    found = read_recording(folder / f"{kind.__name__}.mcap")
    steps = [one.step for one in found if not isinstance(one, Note)]
    say(kind.__name__, "kept", steps == list(range(len(steps))), len(steps) >= 3, len(steps))
last_pose.write(folder / "r1.pose", LastPose((4.0, 5.0, 6.0), (0.0, 0.0, 0.0), 0.25))
say("pose", last_pose.read(folder / "r1.pose").pose)
sys.stderr.write("why it ends\\n")
sys.stderr.flush()
say("log", (folder / "r1.log").read_text())
"""


def test_full_disk_loses_records_but_not_pose_and_log(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    words = on_small_disk(disk, "80k", [sys.executable, "-P", "-c", PROGRAM, str(disk)])
    env = {"PYTHONPATH": str(ROOT), "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
    done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=False, timeout=100)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    full, *lines = done.stdout.splitlines()
    assert full == "full True"
    said = dict(
        line.split(" ", 1) for line in lines if " kept " not in line and line.startswith(("L", "B", "R"))
    )
    kept = {line.split()[0]: line.split()[2:] for line in lines if " kept " in line}
    assert all(one[:2] == ["True", "True"] for one in kept.values()), "what is there is whole, and in order"
    path = {name: f"{disk}/{name}.mcap: cannot be written: no space left on device" for name in kept}
    assert said["Recorder"] == path["Recorder"], "in a simulation it ends the run"
    for name in ("LossyRecorder", "BackgroundRecorder"):
        assert int(said[name]) + int(kept[name][2]) == 203, "each record is kept or counted"
    assert "pose (4.0, 5.0, 6.0)" in lines
    log = [line.removeprefix("log ") for line in lines[lines.index("pose (4.0, 5.0, 6.0)") + 1 :]]
    assert [int(line) for line in log[:150]] == list(range(150))
    assert log[150:] == [
        f"{path['LossyRecorder']}; all further records are lost",
        f"{path['LossyRecorder']}; {said['LossyRecorder']} records lost",
        f"{path['BackgroundRecorder']}; all further records are lost",
        f"{path['BackgroundRecorder']}; {said['BackgroundRecorder']} records lost",
        "why it ends",
        "",
    ]


LINES = 3000
"""More statements than the recorder executes here."""


class Told(BaseException):
    """Raised between two statements, as by a handler of SIGTERM."""


def interrupted(path: Path, at: int) -> bool:
    """Record some steps, interrupted before statement number `at`; False if there are fewer statements."""
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


def test_recording_is_intact_after_a_signal_at_any_statement(tmp_path: Path) -> None:
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
