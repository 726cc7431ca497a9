"""Damaged bytes never crash a parser: each reports an error in one sentence, or accepts them."""

import resource
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.random import Generator

from actors.runtime.errors import AcrcError
from tests.replay.parsers import Parser, parsers

LARGEST = 1 << 17
"""Bytes of one input."""
LONGEST_SENTENCE = 1000
WILD = (
    b"\xff" * 8, bytes(8), b"\x7f\xff\xff\xff", b"\x80" * 4, b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff",
    b"\x91" * 3000, b"[" * 3000, b"{" * 3000, b'{"a":' * 3000, b"a." * 3000, b"0x" + b"f" * 5000, b"1" * 5000,
    b"\x00", b"\x1b[2J", b"1e400", b"-1", b"nan", b"\xed\xa0\x80", b"\xf0\x9f\xa4\x96", b'"""', b"&a *a ",
)  # fmt: skip
"""Unbounded lengths, nestings, numbers and unusual characters."""


def flip(data: bytearray, draw: Generator) -> None:
    data[int(draw.integers(len(data)))] ^= 1 << int(draw.integers(8))


def overwrite(data: bytearray, draw: Generator) -> None:
    data[int(draw.integers(len(data)))] = int(draw.integers(256))


def cut(data: bytearray, draw: Generator) -> None:
    del data[int(draw.integers(len(data) + 1)) :]


def leave_out(data: bytearray, draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    del data[begin : begin + int(draw.integers(64))]


def repeat(data: bytearray, draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    data[begin:begin] = data[begin : begin + int(draw.integers(256))]


def insert_wild(data: bytearray, draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    wild = WILD[int(draw.integers(len(WILD)))]
    data[begin : begin + int(draw.integers(2)) * len(wild)] = wild


WAYS: Sequence[Callable[[bytearray, Generator], None]] = (
    *(flip,) * 6, *(overwrite,) * 4, cut, *(leave_out,) * 2, *(repeat,) * 2, insert_wild,
)  # fmt: skip


def mutated(seeds: Sequence[bytes], draw: Generator) -> bytes:
    """Return one of the seeds, damaged in one to eight places."""
    data = bytearray(seeds[int(draw.integers(len(seeds)))])
    for _ in range(1 + int(draw.integers(8))):
        if data:
            WAYS[int(draw.integers(len(WAYS)))](data, draw)
    return bytes(data[:LARGEST])


def first_failure(parser: Parser, budget: int, draw: Generator) -> str | None:
    """Feed damaged bytes until `budget` is used up; return the first failure other than a sentence."""
    while budget > 0:
        data = mutated(parser.seeds, draw)
        budget -= len(data) or 1
        began = time.process_time()
        try:
            parser.parse(data)
        except AcrcError as error:
            if len(str(error)) > LONGEST_SENTENCE:
                return f"{parser.name}: {data[:200]!r}: an error of {len(str(error))} characters"
        except Exception:
            return f"{parser.name}: {data[:200]!r}: {traceback.format_exc()}"
        if (seconds := time.process_time() - began) > 3.0:
            return f"{parser.name}: {data[:200]!r}: {seconds:.1f} s"
    return None


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.claim("mutations")
def test_damaged_bytes_never_crash_a_parser(
    short_run: Path, tmp_path: Path, full: bool, record_property: Callable[[str, object], None]
) -> None:
    budget = 10_000_000 if full else 50_000
    draw = np.random.default_rng(1)
    before, tried = peak_mb(), 0
    for parser in parsers(tmp_path, short_run):
        assert first_failure(parser, budget, draw) is None
        tried += 1
    assert tried > 35 and peak_mb() - before < 300
    record_property("parsers", tried)
    record_property("bytes per parser", budget)
