"""Damages bytes at random, as lines, disks and people do, and feeds every parser with them."""

import resource
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence, Sized
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator
from rich.table import Table

from actors.runtime.errors import AcrcError
from benchmarks.mutations.parsers import Parser, parsers
from benchmarks.statistics.measured import Measured

LARGEST: Final = 1 << 17
"""Bytes of what comes out."""
_WILD: Final = (
    b"\xff" * 8, bytes(8), b"\x7f\xff\xff\xff", b"\x80" * 4, b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff",
    b"\x91" * 3000, b"[" * 3000, b"{" * 3000, b'{"a":' * 3000, b"a." * 3000, b"0x" + b"f" * 5000, b"1" * 5000,
    b"\x00", b"\x1b[2J", b"1e400", b"-1", b"nan", b"\xed\xa0\x80", b"\xf0\x9f\xa4\x96", b'"""', b"&a *a ",
)  # fmt: skip
"""Lengths beyond all bounds, nestings, numbers, characters that somebody might stumble over."""


def mutated(seeds: Sequence[bytes], draw: Generator) -> bytes:
    """One of the seeds, damaged in one to eight places."""
    data = bytearray(seeds[_index(draw, seeds)])
    for _ in range(1 + int(draw.integers(8))):
        _WAYS[_index(draw, _WAYS)](data, seeds, draw)
    return bytes(data[:LARGEST])


def _index(draw: Generator, things: Sized) -> int:
    return int(draw.integers(len(things)))


def _flip(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    if data:
        data[_index(draw, data)] ^= 1 << int(draw.integers(8))


def _overwrite(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    if data:
        data[_index(draw, data)] = int(draw.integers(256))


def _cut(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    del data[int(draw.integers(len(data) + 1)) :]


def _leave_out(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    del data[begin : begin + int(draw.integers(64))]


def _repeat(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    data[begin:begin] = data[begin : begin + int(draw.integers(256))]


def _splice(data: bytearray, seeds: Sequence[bytes], draw: Generator) -> None:
    other = seeds[_index(draw, seeds)]
    data[int(draw.integers(len(data) + 1)) :] = other[int(draw.integers(len(other) + 1)) :]


def _go_wild(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    wild = _WILD[_index(draw, _WILD)]
    data[begin : begin + int(draw.integers(2)) * len(wild)] = wild


_WAYS: Final[tuple[Callable[[bytearray, Sequence[bytes], Generator], None], ...]] = (
    *(_flip,) * 6, *(_overwrite,) * 4, _cut, *(_leave_out,) * 2, *(_repeat,) * 2, *(_splice,) * 2, _go_wild,
)  # fmt: skip


LONGEST_SENTENCE: int = 1000
"""Characters; what is longer counts as a traceback."""


@dataclass(frozen=True)
class ParserOutcome:
    """What one parser made of its bytes."""

    parser: str
    bytes: int
    inputs: int
    refused: int
    """Of these, with a sentence."""
    longest_s: float
    """For one input, of processor time."""
    grown_mb: float
    """By which the process's peak of memory grew."""
    tracebacks: int
    first: str
    """The first traceback."""


def check(size: int, seed: int = 1) -> Measured:
    """Feed each parser with so many damaged bytes; it holds where none gives a traceback."""
    with tempfile.TemporaryDirectory() as scratch:
        outcomes = [feed(parser, size, seed) for parser in parsers(Path(scratch))]
    shown: list[Table | str] = [_table(outcomes, seed)]
    failed = [outcome for outcome in outcomes if outcome.tracebacks]
    if failed:
        shown.append(f"{sum(one.tracebacks for one in failed)} tracebacks; the first one: {failed[0].first}")
    return Measured([asdict(outcome) for outcome in outcomes], shown, not failed)


def feed(parser: Parser, bytes_: int, seed: int) -> ParserOutcome:
    """Damaged bytes from the seed, one input after the other, until there were so many."""
    draw = np.random.default_rng(seed)
    before = _peak_mb()
    size = inputs = refused = tracebacks = 0
    longest, first = 0.0, ""
    while size < bytes_:
        data = mutated(parser.seeds, draw)
        size += len(data) or 1
        inputs += 1
        began = time.process_time()
        try:
            parser.parse(data)
        except AcrcError as error:
            refused += 1
            if len(str(error)) > LONGEST_SENTENCE:
                tracebacks += 1
                first = first or f"{data[:200]!r}: a sentence of {len(str(error))} characters"
        except Exception:
            tracebacks += 1
            first = first or f"{data[:200]!r}: {traceback.format_exc()}"
        longest = max(longest, time.process_time() - began)
    grown = _peak_mb() - before
    return ParserOutcome(
        parser=parser.name,
        bytes=size,
        inputs=inputs,
        refused=refused,
        longest_s=round(longest, 3),
        grown_mb=round(grown, 1),
        tracebacks=tracebacks,
        first=first,
    )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _table(outcomes: list[ParserOutcome], seed: int) -> Table:
    table = Table(
        "parser", "bytes", "inputs", "refused", "longest", "memory", "tracebacks", title=f"seed {seed}"
    )
    for one in outcomes:
        table.add_row(
            one.parser,
            f"{one.bytes}",
            f"{one.inputs}",
            f"{one.refused}",
            f"{one.longest_s * 1000:.0f} ms",
            f"+{one.grown_mb:.0f} MB",
            f"{one.tracebacks}",
        )
    return table
