"""`acrc verify` reports outcomes of claim tests; benchmarks accept their options."""

import inspect
import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer

from acrc_testbed.command_line.bench import BENCHMARKS, verify
from actors.runtime.errors import AcrcError

ROWS: list[dict[str, Any]] = [
    {"claim": "functions", "outcome": "passed", "seconds": 1.5, "figures": {"sin (ulp)": 0.7}, "reason": ""},
    {"claim": "functions", "outcome": "skipped", "seconds": 0.0, "figures": {}, "reason": "no mpmath"},
    {"claim": "links", "outcome": "failed", "seconds": 2.0, "figures": {}, "reason": ""},
    {"claim": "radio", "outcome": "skipped", "seconds": 0.0, "figures": {}, "reason": "no ns-3"},
]


@pytest.fixture
def words(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Arguments of pytest, which reports ROWS, or aborts if they name `attacks`."""
    given: list[str] = []

    def run(root: Path, words: Sequence[str], stdout: object = None) -> int:
        given.extend(words)
        report = Path(words[words.index("--claim-report") + 1])
        report.write_text(
            "".join(json.dumps(row) + "\n" for row in ROWS if f"--claim={row['claim']}" in words)
        )
        return 3 if "--claim=attacks" in words else 1

    monkeypatch.setattr("acrc_testbed.command_line.development.run_pytest", run)
    return given


def test_each_claim_has_a_row_with_its_verdict(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as ended:
        verify(["functions", "links", "radio", "digest"])
    assert ended.value.exit_code == 1
    shown = capsys.readouterr().out
    for cells in (("functions", "holds", "sin (ulp) 0.7"), ("links", "DOES NOT HOLD"), ("radio", "no ns-3")):
        assert any(all(cell in line for cell in cells) for line in shown.splitlines())
    assert words[words.index("-m") + 1] == "claim" and "--full" not in words
    with pytest.raises(typer.Exit) as ended:
        verify(["functions"], json=True, full=True)
    assert ended.value.exit_code == 0 and "--full" in words
    told = json.loads(capsys.readouterr().out)
    assert told["functions"]["holds"] is True and told["functions"]["s"] == 1.5


def test_all_claims_without_their_nightly_tests(words: list[str]) -> None:
    with pytest.raises(AcrcError, match="pytest aborted with exit code 3"):
        verify(None)
    assert words[words.index("-m") + 1] == "claim and not nightly"


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_accepts_its_options(name: str) -> None:
    measure = import_module(f"acrc_testbed.benchmarks.{BENCHMARKS[name].module}").measure
    assert set(BENCHMARKS[name].options) <= set(inspect.signature(measure).parameters)
