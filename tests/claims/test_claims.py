"""The table of claims: the page is made from it, each names what it takes, and a verdict is told as it is."""

import inspect
import json
import re
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest

from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from benchmarks.claims import verification
from benchmarks.claims.claim import PublishedClaim
from benchmarks.claims.table import CLAIMS
from benchmarks.statistics.measured import Measured
from command_line.bench.bench import BENCHMARKS


def test_the_page_is_made_from_the_table() -> None:
    text = verification.PAGE.read_text()
    assert text == verification.filled(text), "python -m benchmarks.claims.verification makes the tables anew"
    said = re.findall(r"`acrc verify ([\w-]+)` \|$", text, re.MULTILINE)
    assert said == [claim.name for claim in CLAIMS if claim.module]
    assert len({claim.name for claim in CLAIMS}) == len(CLAIMS)


def test_a_table_that_is_missing_or_old_is_made() -> None:
    parts = list(dict.fromkeys(claim.part for claim in CLAIMS))
    bare = "".join(f"\n## {part}\n\nSome words.\n" for part in parts) + "\n## Else\n"
    made = verification.filled(bare)
    assert all(f"Some words.\n\n{verification.table(part)}\n## " in made for part in parts)
    assert verification.filled(made) == made
    assert verification.filled(made.replace("| `acrc verify seal` |", "| `old` |")) == made


@pytest.mark.parametrize("claim", [claim for claim in CLAIMS if claim.module], ids=lambda claim: claim.name)
def test_a_claim_can_be_called_in_both_sizes_with_all_that_it_takes(claim: PublishedClaim) -> None:
    known = inspect.signature(import_module(claim.module).check).parameters
    assert {*claim.small, *claim.full, *claim.takes} <= set(known)
    assert all(0 < small <= full for small, full in [claim.seconds])


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_can_be_called_with_all_that_it_takes(name: str) -> None:
    known = inspect.signature(import_module(BENCHMARKS[name].module).measure).parameters
    assert set(BENCHMARKS[name].takes) <= set(known)


def test_what_is_not_checked_names_what_shows_it() -> None:
    assert [(claim.name, bool(claim.command)) for claim in CLAIMS if not claim.module] == [
        ("links", True),
        ("places", True),
    ]


def test_data_of_ones_own_gets_the_full_size_and_what_is_given_stands_above_both() -> None:
    claim = PublishedClaim("c", "p", "s", "r", small={"runs": 1, "cell": ("few",)}, full={"runs": 20})
    assert claim.settings({}, full=False) == {"runs": 1, "cell": ("few",)}
    assert claim.settings({"runs": 3}, full=False) == {"runs": 3, "cell": ("few",)}
    assert claim.settings({"source": "x"}, full=False) == {"runs": 20, "source": "x"}
    assert claim.settings({"runs": 3}, full=True) == {"runs": 3}


def named(
    monkeypatch: pytest.MonkeyPatch, checks: dict[str, Callable[..., Measured]]
) -> list[PublishedClaim]:
    """Claims that are checked so."""
    monkeypatch.setattr(PublishedClaim, "check", lambda self, settings: checks[self.name](**settings))
    return [PublishedClaim(name, "p", "s", "r", "m", takes=("runs",)) for name in checks]


def fails() -> Measured:
    raise AcrcError("there is no such thing here")


def test_several_claims_are_all_checked_and_those_that_do_not_hold_are_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    right = Measured([1], ("well",), holds=True)
    wrong = Measured([2], ("one of two was lost",), holds=False)
    claims = named(monkeypatch, {"right": lambda: right, "broken": fails, "wrong": lambda: wrong})
    found = verification.verified(claims, {}, full=False)
    assert found.holds is False
    verdicts = {name: (one["holds"], one["found"]) for name, one in found.figures.items()}
    assert verdicts == {
        "right": (True, [1]),
        "broken": (False, {"error": "there is no such thing here"}),
        "wrong": (False, [2]),
    }
    assert verification.told(found, json_output=False) == 1
    printed = capsys.readouterr().out
    assert "one of two was lost" in printed and "broken: there is no such thing here" in printed
    assert "well" not in printed
    assert verification.told(verification.verified(claims[:1], {}, full=False), json_output=True) == 0
    assert json.loads(capsys.readouterr().out)["right"]["holds"] is True


def test_an_option_reaches_those_of_several_claims_that_take_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def told(**settings: Any) -> Measured:
        return Measured(settings, (), holds=True)

    one, other = named(monkeypatch, {"one": told, "other": told})
    other = PublishedClaim("other", "p", "s", "r", "m")
    found = verification.verified([one, other], {"runs": 3}, full=False)
    assert [each["found"] for each in found.figures.values()] == [{"runs": 3}, {}]


@pytest.mark.parametrize(
    ("holds", "verdict", "code"), [(True, "holds", 0), (False, "DOES NOT HOLD", 1), (None, "", 0)]
)
def test_one_claim_prints_all_that_was_found_and_its_verdict(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    holds: bool | None,
    verdict: str,
    code: int,
) -> None:
    (claim,) = named(monkeypatch, {"one": lambda: Measured({"a": 1}, ("found this",), holds)})
    found = verification.verified_alone(claim, {}, full=False)
    assert verification.told(found, json_output=False) == code
    lines = ["found this", *([f"one: {verdict}"] if verdict else [])]
    assert capsys.readouterr().out.splitlines() == lines
    assert verification.told(found, json_output=True) == code
    assert json.loads(capsys.readouterr().out) == {"a": 1}


def test_a_claim_is_checked_once_and_an_unknown_one_refused() -> None:
    assert [claim.name for claim in verification.chosen(["seal", "radio", "seal"])] == ["seal", "radio"]
    assert verification.chosen([]) == [claim for claim in CLAIMS if claim.module]
    with pytest.raises(OptionError, match=r"^CLAIM: glory; must be one of same-bits, processors, "):
        verification.chosen(["glory"])
