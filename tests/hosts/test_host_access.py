"""Who gets in over the links between computers, and what one of the run's own hosts may do."""

from collections.abc import Iterator

import pytest

from benchmarks.attacks.attacked_hosts import AttackedHosts, attacked_hosts
from benchmarks.attacks.host_attacks import HOST_ATTACKS, HostAttack
from tests.hosts.on_host import eventually


@pytest.fixture(scope="module")
def swarm() -> Iterator[AttackedHosts]:
    with attacked_hosts() as made:
        yield made


@pytest.mark.parametrize("attack", HOST_ATTACKS, ids=lambda attack: attack.name)
def test_what_should_not_get_through_does_not(swarm: AttackedHosts, attack: HostAttack) -> None:
    assert attack.act(swarm) is attack.control


def test_a_step_larger_than_a_sockets_buffer_comes_whole_though_nothing_follows(swarm: AttackedHosts) -> None:
    messages = [f"{number} of a large step ".ljust(1400, ".") for number in range(6000)]
    for message in messages:
        swarm.tell("r2", message)
    assert eventually(lambda: swarm.told("r2")[-1:] == messages[-1:])
    assert swarm.told("r2")[-len(messages) :] == messages
