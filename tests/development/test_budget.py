"""The product does not grow: its size stays within the limits of budget.toml, which only go down."""

import tomllib

import pytest

from tests.development.budget import FILE, as_toml, measure, tokens

SLACK = 0.03
"""Share by which a count may lie below its limit before the limit has to be lowered."""
LOWER_LIMIT = False
"""Whether a count that lies further below its limit is a failure."""


@pytest.fixture(scope="module")
def sizes() -> tuple[dict[str, dict[str, int]], dict[str, dict[str, int]]]:
    return measure(), tomllib.loads(FILE.read_text())


@pytest.mark.parametrize("table", ["tokens", "modules"])
def test_size_is_within_its_budget(table: str, sizes: tuple[dict[str, dict[str, int]], ...]) -> None:
    measured, budget = (one[table] for one in sizes)
    wrong = [
        f"[{table}] {name}: {measured.get(name, 0)}, the budget is {budget.get(name, 0)}; write {name} = "
        f"{measured.get(name, 0)} only if it goes down"
        for name in sorted({*measured, *budget})
        if measured.get(name, 0) > budget.get(name, 0)
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("table", ["tokens", "modules"])
def test_a_budget_follows_the_size_down(table: str, sizes: tuple[dict[str, dict[str, int]], ...]) -> None:
    measured, budget = (one[table] for one in sizes)
    wrong = [
        f"[{table}] {name} = {measured.get(name, 0)} is the line to write in tests/development/budget.toml"
        for name, limit in budget.items()
        if measured.get(name, 0) < (1 - SLACK) * limit
    ]
    assert not (LOWER_LIMIT and wrong), "\n".join(wrong)


def test_tokens_are_counted_without_comments_docstrings_and_layout() -> None:
    assert tokens('"""A module."""\n\ndef f(x):  # comment\n    """Doc."""\n    return x + "s"\n') == 10
    assert as_toml({"suite": {"processes": 7}}).endswith("\n\n[suite]\nprocesses = 7\n")
