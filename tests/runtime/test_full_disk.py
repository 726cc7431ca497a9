"""A disk that is really full: a file system of some pages, in a namespace of its own."""

import subprocess
import sys
from pathlib import Path

from tests.small_disk import on_small_disk

ROOT = Path(__file__).parents[2]
PROGRAM = """
import errno, os, sys
from pathlib import Path
import msgspec
from actors.runtime.background import BackgroundRecorder, SparingRecorder
from actors.runtime.lifecycle.log import create_log, write_to
from actors.runtime.recording import Note, Recorder, RecordingError, read_recording
from firmware_bridge.onboard import last_pose
from firmware_bridge.onboard.last_pose import LastPose

folder = Path(sys.argv[1])
out = os.fdopen(os.dup(1), "w")
def message(step): return b"v" + msgspec.msgpack.encode([step, bytes(100)])
def say(*words): print(*words, file=out, flush=True)

last_pose.write(folder / "r1.pose", LastPose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.5))
sys.excepthook = lambda kind, error, trace: say("failed", kind, error, trace.tb_lineno)
write_to(create_log(folder / "r1.log"))
recorders = {kind: kind(folder / f"{kind.__name__}.mcap", 100_000)
             for kind in (SparingRecorder, BackgroundRecorder, Recorder)}
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
                recorder.received("swarm/a", step, step, message(step))
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


def test_records_are_lost_and_counted_the_pose_is_kept_and_the_log_has_room(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    words = on_small_disk(disk, "80k", [sys.executable, "-P", "-c", PROGRAM, str(disk)])
    env = {"PYTHONPATH": str(ROOT), "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
    done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=False, timeout=100)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    full, *lines = done.stdout.splitlines()
    assert full == "full True"
    said = dict(
        line.split(" ", 1) for line in lines if " kept " not in line and line.startswith(("S", "B", "R"))
    )
    kept = {line.split()[0]: line.split()[2:] for line in lines if " kept " in line}
    assert all(one[:2] == ["True", "True"] for one in kept.values()), "what is there is whole, and in order"
    path = {name: f"{disk}/{name}.mcap: cannot be written: no space left on device" for name in kept}
    assert said["Recorder"] == path["Recorder"], "in a simulation it ends the run"
    for name in ("SparingRecorder", "BackgroundRecorder"):
        assert int(said[name]) + int(kept[name][2]) == 203, "each record is kept or counted"
    assert "pose (4.0, 5.0, 6.0)" in lines
    log = [line.removeprefix("log ") for line in lines[lines.index("pose (4.0, 5.0, 6.0)") + 1 :]]
    assert [int(line) for line in log[:150]] == list(range(150))
    assert log[150:] == [
        f"{path['SparingRecorder']}; records are lost from here on",
        f"{path['SparingRecorder']}; {said['SparingRecorder']} records are missing",
        f"{path['BackgroundRecorder']}; records are lost from here on",
        f"{path['BackgroundRecorder']}; {said['BackgroundRecorder']} records are missing",
        "why it ends",
        "",
    ]
