"""Feeds every parser with damaged bytes, and counts what is more than a sentence."""

import json
import resource
import sys
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from actors.runtime.errors import AcrcError
from benchmarks.mutations.mutator import mutated
from benchmarks.mutations.parsers import Parser, parsers

BYTES: int = 10_000_000
SEED: int = 1
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


def run(bytes_: int = BYTES, json_output: bool = False, seed: int = SEED) -> list[ParserOutcome]:
    """Feed each parser with so many bytes; print and give what came of it. AcrcError after a traceback."""
    with tempfile.TemporaryDirectory() as scratch:
        outcomes = [feed(parser, bytes_, seed) for parser in parsers(Path(scratch))]
    if json_output:
        sys.stdout.write(json.dumps([asdict(outcome) for outcome in outcomes]) + "\n")
    else:
        _print(outcomes, seed)
    if failed := [outcome for outcome in outcomes if outcome.tracebacks]:
        raise AcrcError(
            f"{sum(one.tracebacks for one in failed)} tracebacks; the first one: {failed[0].first}"
        )
    return outcomes


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


def _print(outcomes: list[ParserOutcome], seed: int) -> None:
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
    Console(soft_wrap=True).print(table)
