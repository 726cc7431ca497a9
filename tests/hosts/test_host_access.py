"""Who gets in over the links between computers, and what one of the run's own hosts may do."""

from collections.abc import Iterator

import pytest

from benchmarks.attacks.attacked_hosts import AttackedHosts, attacked_hosts
from benchmarks.attacks.host_attacks import HOST_ATTACKS, HostAttack


@pytest.fixture(scope="module")
def swarm() -> Iterator[AttackedHosts]:
    with attacked_hosts() as made:
        yield made


@pytest.mark.parametrize("attack", HOST_ATTACKS, ids=lambda attack: attack.name)
def test_what_should_not_get_through_does_not(swarm: AttackedHosts, attack: HostAttack) -> None:
    assert attack.act(swarm) is attack.control
