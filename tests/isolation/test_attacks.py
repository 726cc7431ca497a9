"""Attacks on the rule that robots communicate by radio only, with and without the layers that block them."""

import os
from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest

from actors.runtime.isolation.sandbox import available
from tests.isolation.attacked_swarm import MODES, Attack, AttackedSwarm, Layer
from tests.isolation.attacks import ATTACKS

WHY_NOT = cache(available)
CASES = [
    pytest.param(mode, attack, id=f"{mode}: {attack.name}")
    for mode in MODES
    for attack in ATTACKS
    if mode != "unguarded" or attack.layer != Layer.PROCESS
]


class RunningSwarms(dict[str, AttackedSwarm]):
    """Swarms by mode, each started on first use."""

    def __init__(self, stack: ExitStack) -> None:
        super().__init__()
        self._stack = stack

    def __missing__(self, mode: str) -> AttackedSwarm:
        self[mode] = self._stack.enter_context(AttackedSwarm(mode))
        return self[mode]


@pytest.fixture(scope="module")
def swarms() -> Iterator[RunningSwarms]:
    with ExitStack() as stack:
        yield RunningSwarms(stack)


def need_isolation() -> None:
    """Skip where robots cannot be isolated; in continuous integration that is a failure."""
    reason = WHY_NOT()
    if reason is None:
        return
    if os.environ.get("CI") == "true":
        pytest.fail(f"isolation must be tested in continuous integration, but {reason}")
    pytest.skip(reason)


def need_means(attack: Attack) -> None:
    """Skip an attack that this user could not carry out against an unprotected swarm either."""
    if attack.root and os.getuid() != 0:
        pytest.skip("only root could do this")
    yama = Path("/proc/sys/kernel/yama/ptrace_scope")
    if attack.traces and os.getuid() != 0 and yama.exists() and yama.read_text().strip() != "0":
        pytest.skip("Yama forbids tracing own processes")


@pytest.mark.claim("attacks")
@pytest.mark.parametrize(("mode", "attack"), CASES)
def test_an_attack_succeeds_only_where_no_layer_blocks_it(
    mode: str, attack: Attack, swarms: RunningSwarms
) -> None:
    if mode == "isolated":
        need_isolation()
    need_means(attack)
    outcome = swarms[mode].carry_out(attack)
    assert outcome.reached == (attack.layer == Layer.NONE or MODES[mode] < attack.layer), outcome
