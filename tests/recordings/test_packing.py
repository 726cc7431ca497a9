"""Packing of large messages in recordings is lossless for any bytes."""

import random
import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import given as drawn
from hypothesis import strategies as some
from mcap.writer import CompressionType, IndexType, Writer

from acrc_testbed.recordings.topics import GrowingRecording
from actors.messages import NO_ECHO_MM, FrameReceived, Odometry, RadioEvents, Scan, SensorData
from actors.runtime.codec import encode
from actors.runtime.recording import Entry, Recorder, RecordingError, RecordingReader, read_recording
from actors.runtime.recording.format import (
    DEFLATED,
    LARGEST_RECORD,
    MESSAGES,
    SCANNED,
    MessagePacker,
    MessageUnpacker,
)
from actors.runtime.recording.reader import FAULTS
from actors.runtime.recording.scans import LARGEST, ScanBuffers

SENSES, RECEIVED = "swarm/down/r1/senses", "swarm/down/r1/received"


def wall(rays: int, rng: np.random.Generator) -> bytes:
    """Return a scan along walls, with edges and missing echoes."""
    ranges = 2500 + np.cumsum(rng.integers(-20, 21, rays))
    ranges[rays // 2 :] += 1700
    ranges[rays // 3 : rays // 3 + 20] = NO_ECHO_MM
    return ranges.astype("<u2").tobytes()


def senses(step: int, *scans: bytes) -> bytes:
    seen = [Scan(step * 100_000, scan) for scan in scans]
    odometry = Odometry(step / 7, -step / 3, 0.1 * step, 0.2, 0.0, 0.0)
    last = seen[-1] if seen else None
    return encode(SensorData(step, step * 100_000, 1, odometry, 0, last, earlier_scans=tuple(seen[:-1])))


def received(step: int, rng: np.random.Generator) -> bytes:
    frames = [rng.bytes(49) for _ in range(3)] * 2
    heard = (FrameReceived(step, n, -60.5 - n, 200, data) for n, data in enumerate(frames))
    return encode(RadioEvents(step, tuple(heard)))


def payloads() -> Iterator[bytes]:
    rng = np.random.default_rng(3)
    for step in range(200):
        rays, rough = int(rng.integers(0, 700)), int(rng.choice([1, 3, 30, 300, 3000, 40_000]))
        ranges = (np.cumsum(rng.integers(-rough, rough + 1, rays)) % 65536).astype("<u2").tobytes()
        yield from (senses(step), senses(step, ranges), senses(step, wall(360, rng), wall(640, rng)))
        yield received(step, rng)
    for size in (0, 1, 127, 128, 129, 1000, 60_000, 200_000):
        yield from (rng.bytes(size), bytes(size), b"\xc5" * size)
        for length in (size // 2 + 1 & ~1, size - 4 & ~1, size):
            yield b"\x04" + b"\xc5" + (length & 0xFFFF).to_bytes(2) + rng.bytes(max(size - 4, 0))
    for constant in (0, 1, 0x7FFF, 0x8000, NO_ECHO_MM):
        yield senses(1, np.full(640, constant, "<u2").tobytes())
    yield senses(1, np.tile([0, 0xFFFF, 0x8000, 0x7FFF], 160).astype("<u2").tobytes())
    yield senses(1, bytes(64_800))


def test_packing_is_lossless() -> None:
    packer, unpacker, ways = MessagePacker(), MessageUnpacker(), set()
    for payload in payloads():
        encoding, data = packer.packed(payload)
        ways.add(encoding)
        assert unpacker.unpacked(encoding, data) == payload
    assert ways == {MESSAGES, SCANNED, DEFLATED}


def written(path: Path) -> list[bytes]:
    rng, given = np.random.default_rng(6), []
    with Recorder(path, 100_000) as recorder:
        for step in range(12):
            for key, payload in ((SENSES, senses(step, wall(640, rng))), (RECEIVED, received(step, rng))):
                recorder.received(key, step, step, payload)
                given.append(payload)
            recorder.flush()
    return given


def read(path: Path) -> list[bytes | None]:
    return [item.payload for item in read_recording(path) if isinstance(item, Entry)]


@drawn(
    kind=some.sampled_from(["cut", "zeros", "block", "garbage", "longer"]),
    at=some.floats(0, 1),
    seed=some.integers(0, 999),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_reading_after_a_power_failure(tmp_path: Path, kind: str, at: float, seed: int) -> None:
    path, bad = tmp_path / "r1.mcap", tmp_path / "bad.mcap"
    path.unlink(missing_ok=True)
    steps, whole = written(path), path.read_bytes()
    place = 8 + int(at * (len(whole) - 8))
    noise = random.Random(seed).randbytes(512)
    data = {
        "cut": whole[:place],
        "zeros": whole[:place] + bytes(len(whole) - place),
        "block": whole[:place] + bytes(512) + whole[place + 512 :],
        "garbage": whole[:place] + noise,
        "longer": whole + noise,
    }[kind]
    bad.write_bytes(data)
    found = read(bad)
    assert found == steps[: len(found)]
    with GrowingRecording(bad) as growing:
        assert [one.payload for one in growing.poll()] == found
    strict = RecordingReader(bad, strict=True)
    taken = []
    with suppress(RecordingError):
        for item in strict:
            assert isinstance(item, Entry)
            taken.append(item.payload)
    assert taken == found
    assert kind == "cut" or data == whole or not strict.whole
    assert kind != "longer" or (strict.damage is not None and found == steps)


def test_invalid_packed_scans_are_rejected() -> None:
    payload = senses(1, wall(640, np.random.default_rng(8)))
    _, data = MessagePacker().packed(payload)
    at = 2 + int.from_bytes(data[:2])
    size, count = int.from_bytes(data[at + 1 : at + 3]), data[at + 3 : at + 5]
    lies = {
        "no place": data[:1],
        "a place behind its end": b"\xff\xff" + data[2:],
        "a place where nothing is": (at + 1).to_bytes(2) + data[2:],
        "a length behind its end": data[: at + 1] + b"\xff\xff" + data[at + 3 :],
        "a length of nothing": data[: at + 1] + b"\x00\x00" + data[at + 3 :],
        "a byte less": data[: at + 1] + (size - 1).to_bytes(2) + data[at + 3 :],
        "more ranges": data[: at + 3] + b"\x7f\xff" + data[at + 5 :],
        "more than there may be": data[: at + 3] + b"\xff\xff" + data[at + 5 :],
        "fewer ranges": data[: at + 3] + b"\x00\x10" + data[at + 5 :],
        "ones alone": data[: at + 5] + b"\xff" * (size - 2),
        "other bits to the end": data[: at + 5] + b"\x00" * (size - 2),
    }
    assert count == (640).to_bytes(2)
    rng, buffers = np.random.default_rng(9), ScanBuffers()
    for _ in range(1000):
        noise = rng.bytes(int(rng.integers(0, 60))) + rng.choice([b"", b"\xfe" * 40, b"\x7f" * 40])
        with suppress(ValueError):
            assert len(buffers.unpacked(noise, int(rng.integers(0, 60)))) < 2 * 60
    with pytest.raises(ValueError, match="is too large"):
        buffers.unpacked(bytes(LARGEST + 1), 1)
    for name, lie in lies.items():
        with pytest.raises(FAULTS):
            pytest.fail(f"{name}: {len(MessageUnpacker().unpacked(SCANNED, lie))} bytes")


def test_decompression_bomb_is_limited() -> None:
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15)
    parts = [deflate.compress(bytes(LARGEST_RECORD)) for _ in range(12)]
    bomb = b"".join(parts) + deflate.flush(zlib.Z_SYNC_FLUSH)[:-4]
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="is incomplete"):
            MessageUnpacker().unpacked(DEFLATED, bomb)
        assert tracemalloc.get_traced_memory()[1] < 2.5 * LARGEST_RECORD
    finally:
        tracemalloc.stop()
    ended = zlib.compressobj(1, zlib.DEFLATED, -15)
    with pytest.raises(ValueError, match="is incomplete"):
        MessageUnpacker().unpacked(DEFLATED, ended.compress(bytes(500)) + ended.flush())


def test_many_decompression_bombs_are_rejected(tmp_path: Path) -> None:
    path, deflate = tmp_path / "r1.mcap", zlib.compressobj(9, zlib.DEFLATED, -15)
    with path.open("wb") as file:
        writer = Writer(
            file, compression=CompressionType.NONE, index_types=IndexType.NONE, use_chunking=False
        )
        writer.start(profile="acrc", library="acrc")
        channel = writer.register_channel(RECEIVED, DEFLATED, 0, {"direction": "in"})
        for number in range(6):
            data = deflate.compress(b"\x04" + msgspec.msgpack.encode([1, bytes(LARGEST_RECORD // 2)]))
            writer.add_message(channel, 0, data + deflate.flush(zlib.Z_SYNC_FLUSH)[:-4], 0, number)
        writer.finish()  # type: ignore[no-untyped-call]
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError, match="bytes without a checksum"):
            list(RecordingReader(path, strict=True))
        assert tracemalloc.get_traced_memory()[1] < 5 * LARGEST_RECORD
    finally:
        tracemalloc.stop()
