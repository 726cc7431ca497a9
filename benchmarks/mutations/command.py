"""Feeds every parser with damaged bytes, and counts what is more than a sentence."""

import resource
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from actors.runtime.errors import AcrcError
from benchmarks.mutations.mutator import mutated
from benchmarks.mutations.parsers import Parser, parsers
from benchmarks.statistics.measured import Measured

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
        parser.name, size, inputs, refused, round(longest, 3), round(grown, 1), tracebacks, first
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
