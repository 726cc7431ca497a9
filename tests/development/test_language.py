"""Banned words and openings in docstrings, messages and pages are within their budget."""

import tomllib
from collections import Counter

from tests.development.budget import FILE
from tests.development.language import findings


def test_language_is_within_its_budget() -> None:
    limits = {**tomllib.loads(FILE.read_text())["language"], "docs": 0}
    found = list(findings())
    exceeded = {
        name for name, count in Counter(one.package for one in found).items() if count > limits.get(name, 0)
    }
    assert not exceeded, "\n".join(
        f"{one.file}:{one.line}: {one.found}" for one in found if one.package in exceeded
    )
