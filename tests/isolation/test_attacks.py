"""The only way to a peer is the radio: every other way is tried, with and without what closes it.

The robots that are isolated are those of the benchmark, which tries all attacks on them.
"""

import os
from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest

from actors.runtime.isolation.sandbox import available
from benchmarks.attacks import command
from benchmarks.attacks.attack import Attack, Layer, missing_means
from benchmarks.attacks.attacks import ATTACKS, table
from benchmarks.attacks.host_attacks import HOST_ATTACKS, host_table
from benchmarks.attacks.swarm import MODES, AttackedSwarm
from benchmarks.statistics.measured import Measured

SEEN_BY_ALL = ("page cache", "common file")
"""Attacks by way of a file that nobody else may open meanwhile; each name has one of these words."""
WHY_NOT = cache(available)
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "isolation.md"


@pytest.fixture(scope="module")
def swarms() -> Iterator[dict[str, AttackedSwarm]]:
    """The swarms whose robots are not isolated, started when first asked for."""
    with ExitStack() as stack:

        class Started(dict[str, AttackedSwarm]):
            def __missing__(self, mode: str) -> AttackedSwarm:
                self[mode] = stack.enter_context(AttackedSwarm(mode))
                return self[mode]

        yield Started()


@pytest.fixture(scope="module")
def checked() -> Measured:
    """What came of all attacks on isolated robots."""
    need_isolation()
    return command.check()


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
    index: int, mode: str, swarms: dict[str, AttackedSwarm]
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
    text = DOCUMENT.read_text("utf-8")
    assert table() in text, "python -m benchmarks.attacks.attacks prints the table"
    assert host_table() in text, "python -m benchmarks.attacks.host_attacks prints the table"


@pytest.mark.alone
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_on_isolated_robots_gets_through_only_if_nothing_closes_its_way(
    attack: Attack, checked: Measured
) -> None:
    need_means(attack)
    outcomes = {verdict["name"]: verdict["outcome"] for verdict in checked.figures}
    if attack.layer == Layer.NONE:
        assert attack.name not in outcomes, "a control that does not get through ends the check"
        return
    assert outcomes[attack.name] == ("through" if attack.layer == Layer.REMAINS else "held")


@pytest.mark.alone
def test_the_claim_holds_and_every_attack_is_told(checked: Measured) -> None:
    assert checked.holds
    within = sum(attack.layer != Layer.NONE for attack in ATTACKS)
    assert len(checked.figures) == within + sum(not attack.control for attack in HOST_ATTACKS)


def test_the_claim_does_not_hold_where_something_gets_through_unstated() -> None:
    remains = [attack for attack in ATTACKS if attack.layer == Layer.REMAINS]
    text = DOCUMENT.read_text("utf-8")
    assert all(command.is_stated(attack, text) for attack in remains)
    silent = text.replace(remains[0].name, "all is well")
    verdicts = [
        command.AttackVerdict(attack.name, attack.closed_by, "through", command.is_stated(attack, silent))
        for attack in remains
    ]
    found = command.told(verdicts)
    assert found.holds is False
    assert found.shown[-1] == f"through, and isolation.md does not say so: {remains[0].name}"
