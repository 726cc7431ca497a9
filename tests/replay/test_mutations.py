"""A sample of `acrc verify mutations`: damaged bytes over every parser, and never more than a sentence."""

from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from benchmarks.mutations.command import feed
from benchmarks.mutations.parsers import Parser, parsers

BYTES = 40_000


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_bytes_are_a_sentence_at_most(recorded: Path, tmp_path: Path, seed: int) -> None:
    outcomes = [feed(parser, BYTES, seed) for parser in parsers(tmp_path, recorded)]
    assert len(outcomes) > 35
    assert [(one.parser, one.first) for one in outcomes if one.tracebacks] == []
    assert max(one.longest_s for one in outcomes) < 3 and max(one.grown_mb for one in outcomes) < 300


def test_a_traceback_and_an_endless_sentence_are_counted() -> None:
    def fragile(data: bytes) -> None:
        if data[:1] != b"a":
            raise AcrcError("x" * 2000)
        if data[1:2] != b"b":
            raise KeyError(data)

    outcome = feed(Parser("fragile", (b"abcdef",), fragile), 20_000, 1)
    assert outcome.refused > 0 and outcome.tracebacks > outcome.refused and outcome.first
