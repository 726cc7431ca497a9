"""Attacks on the rule that robots communicate by radio only, with and without the layers that block them."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest

from actors.runtime.isolation.sandbox import isolation_fault
from tests.isolation.attacked_swarm import MODES, Attack, AttackedSwarm, Layer
from tests.isolation.attacks import ATTACKS

WHY_NOT = cache(isolation_fault)
CASES = [
    pytest.param(mode, attack, id=f"{mode}: {attack.name}")
    for mode in MODES
    for attack in ATTACKS
    if mode != "unguarded" or attack.layer != Layer.PROCESS
]


@pytest.fixture(scope="module")
def swarms() -> Iterator[Callable[[str], AttackedSwarm]]:
    with ExitStack() as stack:
        yield cache(lambda mode: stack.enter_context(AttackedSwarm(mode)))


def need_isolation() -> None:
    reason = WHY_NOT()
    if reason is None:
        return
    if os.environ.get("CI") == "true":
        pytest.fail(f"isolation must be tested in continuous integration, but {reason}")
    pytest.skip(reason)


def need_means(attack: Attack) -> None:
    yama = Path("/proc/sys/kernel/yama/ptrace_scope")
    if attack.traces and os.getuid() != 0 and yama.exists() and yama.read_text().strip() != "0":
        pytest.skip("Yama forbids tracing own processes")


@pytest.mark.claim("attacks")
@pytest.mark.parametrize(("mode", "attack"), CASES)
def test_an_attack_succeeds_only_where_no_layer_blocks_it(
    mode: str, attack: Attack, swarms: Callable[[str], AttackedSwarm]
) -> None:
    if mode == "isolated":
        need_isolation()
    need_means(attack)
    reached, refused = swarms(mode).run_campaign(attack)
    assert reached == (attack.layer == Layer.NONE or MODES[mode] < attack.layer), refused
