"""The only way to a peer is the radio: every other way is tried, with and without what closes it.

The robots that are isolated are those of the benchmark, which tries all attacks on them.
"""

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, redirect_stdout
from dataclasses import asdict
from functools import cache
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import pytest

from actors.runtime.isolation.sandbox import available
from benchmarks.attacks import command
from benchmarks.attacks.attack import Attack, Layer, missing_means
from benchmarks.attacks.attacks import ATTACKS
from benchmarks.attacks.swarm import MODES, Swarm
from benchmarks.attacks.table import table

SEEN_BY_ALL = ("page cache", "common file")
"""Attacks by way of a file that nobody else may open meanwhile; each name has one of these words."""
WHY_NOT = cache(available)
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "isolation.md"


@pytest.fixture(scope="module")
def swarms() -> Iterator[dict[str, Swarm]]:
    """The swarms whose robots are not isolated, started when first asked for."""
    with ExitStack() as stack:

        class Started(dict[str, Swarm]):
            def __missing__(self, mode: str) -> Swarm:
                self[mode] = stack.enter_context(Swarm(mode))
                return self[mode]

        yield Started()


class Benched(NamedTuple):
    """What the benchmark made of the isolated robots, and printed."""

    verdicts: dict[str, command.AttackVerdict]
    """By the attack's name."""
    printed: str


@pytest.fixture(scope="module")
def benched() -> Benched:
    need_isolation()
    with redirect_stdout(StringIO()) as printed:
        verdicts = command.run(json_output=True)
    return Benched({verdict.name: verdict for verdict in verdicts}, printed.getvalue())


def need_isolation() -> None:
    """Skip where robots cannot be isolated; in continuous integration that is a failure."""
    reason = WHY_NOT()
    if reason is None:
        return
    if os.environ.get("CI") == "true":
        pytest.fail(f"isolation must be tested in continuous integration, but {reason}")
    pytest.skip(reason)


def need_means(attack: Attack) -> None:
    """Skip an attack that this user could not carry out even against an unprotected swarm."""
    reason = missing_means(attack)
    if reason is not None:
        pytest.skip(reason)


def marks(attack: Attack) -> tuple[pytest.MarkDecorator, ...]:
    return (pytest.mark.alone,) if any(word in attack.name for word in SEEN_BY_ALL) else ()


CASES = [
    pytest.param(index, mode, id=f"{mode}: {attack.name}", marks=marks(attack))
    for mode in MODES
    for index, attack in enumerate(ATTACKS)
    if mode == "open" or (mode == "unguarded" and attack.layer <= Layer.RULES)
]


@pytest.mark.parametrize(("index", "mode"), CASES)
def test_an_attack_gets_through_only_where_nothing_closes_its_way(
    index: int, mode: str, swarms: dict[str, Swarm]
) -> None:
    attack = ATTACKS[index]
    need_means(attack)
    outcome = swarms[mode].carry_out(index)
    expected = attack.layer == Layer.NONE or MODES[mode] < attack.layer
    assert outcome.reached == expected, outcome


def test_attacks_have_names_of_their_own() -> None:
    names = [attack.name for attack in ATTACKS]
    assert len(set(names)) == len(names)


def test_the_documentation_has_the_table_of_attacks() -> None:
    assert table() in DOCUMENT.read_text("utf-8"), "python -m benchmarks.attacks.table prints the table"


@pytest.mark.alone
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_on_isolated_robots_gets_through_only_if_nothing_closes_its_way(
    attack: Attack, benched: Benched
) -> None:
    need_means(attack)
    if attack.layer == Layer.NONE:
        assert attack.name not in benched.verdicts, "a control that does not get through ends the benchmark"
        return
    assert benched.verdicts[attack.name].outcome == ("through" if attack.layer == Layer.REMAINS else "held")


@pytest.mark.alone
def test_the_benchmark_prints_what_it_found(benched: Benched) -> None:
    assert json.loads(benched.printed) == [asdict(verdict) for verdict in benched.verdicts.values()]
    assert len(benched.verdicts) == sum(attack.layer != Layer.NONE for attack in ATTACKS)


def test_what_gets_through_unstated_fails_the_benchmark() -> None:
    remains = [attack for attack in ATTACKS if attack.layer == Layer.REMAINS]
    text = DOCUMENT.read_text("utf-8")
    assert all(command.is_stated(attack, text) for attack in remains)
    silent = text.replace(remains[0].name, "all is well")
    verdicts = [
        command.AttackVerdict(attack.name, attack.closed_by, "through", command.is_stated(attack, silent))
        for attack in remains
    ]
    with pytest.raises(command.AttacksError) as caught:
        command.judge(verdicts)
    assert str(caught.value) == f"through, and isolation.md does not say so: {remains[0].name}"
