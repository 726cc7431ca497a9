"""`acrc record check` finds damage and contradictions; replays name the processor of a recording."""

import json
import shutil
from collections import deque
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

from acrc_testbed.recordings.record_check import CheckError, check_run
from acrc_testbed.recordings.record_replay import replay_actor
from actors.messages import SensorData
from actors.robot import assembly
from actors.runtime.codec import decode, encode
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.processor import Processor, processor
from actors.runtime.recording import (
    Entry,
    Note,
    Recorder,
    RecordingError,
    RecordingReader,
    read_notes,
    read_recording,
)
from actors.runtime.replay_bus import ReplayError, topic_of
from tests.in_process import acrc
from tests.replay.forging import forge, with_payload


def fault(out: Path) -> str:
    with pytest.raises(AcrcError) as caught:
        check_run(out)
    return str(caught.value)


def flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1 << at % 8]) + content[at + 1 :]


def test_flipped_bits_are_detected_without_traceback(copy: Path) -> None:
    """60 bits of all recordings, and many at the end of one, where counters and sums are."""
    report = check_run(copy)
    assert report.complete and report.unreceived == 0
    assert report.digest == json.loads((copy / "run.json").read_text())["digest"]
    files = sorted(copy.glob("*/*.mcap"))
    every = sum(path.stat().st_size for path in files) // 60
    for path in files:
        sound = path.read_bytes()
        for at in range(every // 2, len(sound), every):
            path.write_bytes(flipped(sound, at))
            said = fault(copy)
            assert "\n" not in said and str(path) in said, (path, at)
        path.write_bytes(sound)
    last = copy / "r1" / "r1.mcap"
    sound = last.read_bytes()
    for at in range(len(sound) - 750, len(sound), 3):
        last.write_bytes(flipped(sound, at))
        with suppress(RecordingError):
            reading = RecordingReader(last)
            deque(reading, 0)
            assert not reading.whole, at


def test_truncated_run_reports_last_valid_step(copy: Path) -> None:
    path = copy / "r1" / "r1.mcap"
    sound = path.read_bytes()
    path.write_bytes(sound[: len(sound) // 2])
    last = max(item.step for item in read_recording(path) if isinstance(item, Entry))
    assert 5 < last < 25
    assert fault(copy) == (
        f"{path}: ends after step {last}, but the run has a result; the file is truncated or damaged"
    )
    (copy / "run.json").unlink()
    report = check_run(copy)
    assert (report.complete, report.good_until) == (False, last)
    done = acrc("record", "check", copy)
    assert done.returncode == 0
    assert done.stdout.splitlines()[-2].endswith(f"; recordings: complete up to step {last}")


def test_truncated_recording_is_read_to_its_last_complete_step(copy: Path) -> None:
    path = copy / "r2" / "r2.mcap"
    (copy / "run.json").unlink()
    sound = path.read_bytes()
    until = []
    for length in range(0, len(sound), 1499):
        path.write_bytes(sound[:length])
        try:
            report = check_run(copy)
        except CheckError as error:  # not even its first record
            assert str(error) == f"{path}: ends before its first record"
        else:
            assert not report.complete
            until.append(-1 if report.good_until is None else report.good_until)
    assert until == sorted(until) and until[0] == -1 and until[-1] == 30


def test_robot_killed_at_startup_is_part_of_a_truncated_run(copy: Path) -> None:
    (copy / "run.json").unlink()
    world, robot = copy / "world" / "world.mcap", copy / "r2" / "r2.mcap"
    robot.write_bytes(b"")
    assert fault(copy) == f"{robot}: ends before its first record", "all others have ended as planned"
    world.write_bytes(world.read_bytes()[: world.stat().st_size // 2])
    report = check_run(copy)
    assert not report.complete and report.good_until is None


class Earlier(msgspec.Struct):
    """Note of a version without set-ups in recordings."""

    actor: str = "r1"
    argv: tuple[str, ...] = ("--id", "r1")
    seed: int = 7
    step_us: int = 100_000
    commit: str = "abc"
    scenario: str = "{}"


def test_received_bytes_differ_from_sent(copy: Path) -> None:
    def change(item: Entry | Note) -> Entry | Note:
        if not isinstance(item, Entry) or item.step != 7 or not item.key.endswith("/senses"):
            return item
        assert item.payload is not None
        message = decode(topic_of(item.key), item.key, item.payload)
        assert isinstance(message, SensorData)
        return with_payload(item, encode(msgspec.structs.replace(message, bumper=7)))

    path = copy / "r1" / "r1.mcap"
    forge(path, change)
    assert fault(copy).startswith(f"{path}: contains ")  # differs from the process's count
    forge(path, lambda item: None if isinstance(item, Note) and item.name == "final" else item)
    (copy / "run.json").unlink()
    key = "swarm/down/r1/senses"
    assert fault(copy) == f"step 7: a message that r1 received on {key} differs from what world sent"
    forge(path, lambda item: None if isinstance(item, Entry) and item.step == 9 else item)
    assert "has number" in fault(copy)
    path.write_bytes((copy / "r2" / "r2.mcap").read_bytes())
    assert fault(copy) == f"{path}: recording of 'r2' instead of 'r1'"
    path.unlink()
    with Recorder(path, 100_000) as recorder:
        recorder.note("run", Earlier())
    assert fault(copy).startswith(f"{path}: invalid record 'run': it has no set-up; ver")


def test_wrong_counters(copy: Path) -> None:
    def boast(item: Entry | Note) -> Entry | Note:
        if not isinstance(item, Note) or item.name != "final":
            return item
        final = msgspec.json.decode(item.json, type=FinalNote)
        lie = msgspec.structs.replace(final, published=10**9, sent={"swarm/up/r1/drive": 10**9})
        return Note("final", msgspec.json.encode(lie).decode())

    path = copy / "r1" / "r1.mcap"
    forge(path, boast)
    assert fault(copy) == f"{path}: number of sent messages differs from the process's count"


def test_recordings_in_unexpected_places(copy: Path) -> None:
    stray = copy / "r1" / "world.mcap"
    stray.write_bytes((copy / "world" / "world.mcap").read_bytes())
    assert fault(copy).startswith(f"{stray}: unexpected recording; this folder may contain r1.mcap")
    stray.unlink()
    path = copy / "r1" / "r1.mcap"
    path.rename(copy / "elsewhere")
    path.symlink_to(copy / "elsewhere")
    assert fault(copy) == f"{path}: is a symbolic link, not a recording"


def test_files_other_than_recordings(tmp_path: Path) -> None:
    path = tmp_path / "r1" / "r1.mcap"
    path.parent.mkdir()
    magic = b"\x89MCAP0\r\n"
    wild = magic + b"\x01" + (1 << 40).to_bytes(8, "little")
    for content, why in (
        (magic, "ends before its first record"),
        (b"12345678", "not a recording, or damaged at its start"),
        (wild, "damaged before the first step, read up to there: a record has 1099511627776 bytes; "),
    ):
        path.write_bytes(content)
        assert fault(tmp_path).startswith(f"{path}: {why}")
    path.unlink()
    path.symlink_to(path)
    assert fault(tmp_path) == f"{path}: is a symbolic link, not a recording"
    path.unlink()
    path.mkdir()
    assert fault(tmp_path) == f"{path}: is not a regular file"


ELSEWHERE = Processor("aarch64", "Cortex-A76", ("neon",))
SINE = "actors.portable.arrays.sin"


def from_elsewhere(item: Entry | Note) -> Entry | Note:
    """Change the run's note to another processor, with different results of the sine."""
    if not isinstance(item, Note) or item.name != "run":
        return item
    run = msgspec.json.decode(item.json, type=RunNote)
    assert SINE in run.kernels
    other = msgspec.structs.replace(run, processor=ELSEWHERE, kernels=run.kernels | {SINE: "0" * 64})
    return item._replace(json=msgspec.json.encode(other).decode())


def from_elsewhere_and_different(item: Entry | Note) -> Entry | Note:
    """Do the same, and change the last bit of what the robot sent in step 5."""
    if isinstance(item, Entry) and item.direction == "out" and item.step == 5 and item.payload is not None:
        return with_payload(item, item.payload[:-1] + bytes([item.payload[-1] ^ 1]))
    return from_elsewhere(item)


def test_result_and_first_record_name_the_processor(recorded: Path) -> None:
    here = processor()
    result = json.loads((recorded / "run.json").read_text())
    assert msgspec.convert(result["processor"], Processor) == here
    for path in sorted(recorded.glob("*/*.mcap")):
        run = msgspec.json.decode(read_notes(path)["run"], type=RunNote)
        assert run.processor == here
        assert SINE in run.kernels and "actors.portable.foundations.numpy.sqrt" in run.kernels


def test_a_replay_that_differs_names_processor_function_and_features(copy: Path, recorded: Path) -> None:
    assert SINE in assembly.kernels()
    forge(copy / "r1" / "r1.mcap", from_elsewhere_and_different)
    with pytest.raises(ReplayError) as caught:
        replay_actor(copy, "r1")
    assert str(caught.value).endswith(
        f"; recorded on another processor: results of {SINE} differ; "
        f"it was {ELSEWHERE}, this is {processor()}"
    )
    assert "step 5" in str(caught.value)
    shutil.copy(recorded / "r1" / "r1.mcap", copy / "r1")
    forge(copy / "r1" / "r1.mcap", from_elsewhere)
    assert replay_actor(copy, "r1").outputs > 30, "the other bits of the function changed no output"
