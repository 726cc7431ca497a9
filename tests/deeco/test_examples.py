"""The published applications of JDEECo: what they show, also with other losses; their size."""

import io
import tokenize
from itertools import pairwise
from pathlib import Path

import pytest

from examples.cleaning_robots import clean
from examples.convoy import drive
from examples.drones import protect
from examples.firefighters import fight
from examples.parking import park

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("cleaning_robots", "convoy", "drones", "firefighters", "parking")


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_the_leader_learns_of_flashovers_oxygen_and_lost_members(loss: float) -> None:
    rows = list(fight(loss))
    assert rows[2] == {"ann": "well", "bob": "well", "eve": "flashover"}
    assert rows[5]["ann"] == "low oxygen" and rows[5]["bob"].startswith("lost at 3")
    assert all(not state.startswith("lost") for row in rows for name, state in row.items() if name != "bob")


def test_without_radio_there_are_no_reports() -> None:
    assert list(fight(1.0)) == [{}] * 6


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.4])
def test_car_parks_are_never_overfull_and_places_are_freed(loss: float) -> None:
    first, second, third = park(loss)
    assert len(first["near"]) == len(second["near"]) == len(third["near"]) == 1
    assert {*first["near"], *first["far"]} == {"a", "b", "c"}
    assert {*second["near"], *second["far"]} == {"a", "b", "c"} - {*first["near"]}
    assert third["far"] == ()


def test_blocked_robots_exchange_their_destinations_only_by_radio() -> None:
    states = list(clean())[-1]
    assert [goal for _, goal in states] == [-1.0, 9.0] == pytest.approx([place for place, _ in states])
    for before, after in pairwise(clean(1.0)):
        assert [goal for _, goal in before] == [goal for _, goal in after] == [9.0, -1.0]
        assert after[1][0] - after[0][0] > 1.0


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.4])
def test_drones_protect_the_more_important_field_and_charge_in_turn(loss: float) -> None:
    rows = list(protect(loss))
    assert all(1 <= len(row["corn"]) <= 2 and len(row["wheat"]) <= 2 for row in rows)
    assert all(not {*row["corn"]} & {*row["wheat"]} for row in rows)
    assert all(len(row["charger"]) <= 1 for row in rows) and any(row["charger"] for row in rows)


def test_without_radio_no_drone_has_a_field() -> None:
    assert list(protect(1.0)) == [{"corn": [], "wheat": [], "charger": []}] * 5


def test_a_convoy_closes_up() -> None:
    assert list(drive(loss=0.1))[-1] == pytest.approx([20.0] * 3, abs=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_an_example_has_fewer_than_80_lines_of_code(name: str) -> None:
    """Count lines with code; comments, docstrings and blank lines do not count."""
    source = (EXAMPLES / f"{name}.py").read_text("utf-8")
    lines, previous = set[int](), tokenize.NEWLINE
    for one in tokenize.generate_tokens(io.StringIO(source).readline):
        layout = {tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT}
        is_docstring = one.type == tokenize.STRING and previous in {*layout, tokenize.ENCODING}
        if one.type not in layout and not is_docstring:
            lines.update(range(one.start[0], one.end[0] + 1))
        previous = one.type
    assert len(lines) < 80
