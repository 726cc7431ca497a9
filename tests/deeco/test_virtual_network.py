"""Network with virtual time: delays, losses, steps and mistaken names."""

import pytest

from deeco import DefinitionError, ExecutionError, Instant, Knowledge, component, milliseconds, role, seconds
from deeco.link import Transmission
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork
from tests.deeco.refusals import refused


@role
class Lamp(Knowledge):
    level: int = 0


@component
class Light(Lamp):
    """A component without processes."""


def lights(*names: str) -> dict[str, Node]:
    return {name: Node([Light(id=name)], address=number) for number, name in enumerate(names, start=1)}


def test_frames_arrive_in_the_step_after_their_transmission_at_the_earliest() -> None:
    network = VirtualNetwork(lights("a", "b"), step=milliseconds(20))
    network.advance(milliseconds(20))
    assert [sender for sender, _ in network.medium.sent] == ["a", "b"]
    assert not network["b"].replicas
    network.advance(milliseconds(1))
    assert network.now == 40_000
    assert [one.id for one in network["b"].replicas] == ["a"]


def test_losses_and_delays_are_equal_for_equal_seeds() -> None:
    def heard(seed: int) -> list[Instant]:
        medium = LossyMedium(0.5, (milliseconds(10), milliseconds(30)), seed=seed)
        for number in range(400):
            medium.send("a", Transmission(Instant(number), b"x"), ["a", "b"])
        assert medium.receive("a", Instant(seconds(1))) == []
        received = medium.receive("b", Instant(seconds(1)))
        assert {one.sender for one in received} == {1}
        assert 160 < len(received) < 240  # 4 standard deviations of 10
        assert all(10_000 <= one.instant <= 30_400 for one in received)
        return [one.instant for one in received]

    assert heard(1) == heard(1) != heard(2)


def test_an_unknown_participant_a_wrong_step_and_a_condition_that_never_holds() -> None:
    network = VirtualNetwork(lights("a", "b"))
    with refused("the network has no participant 'c'; use one of a, b", ExecutionError):
        network["c"]
    with refused(
        "VirtualNetwork: step=1 has no unit; use seconds(...) or milliseconds(...)", DefinitionError
    ):
        VirtualNetwork(lights("a"), step=1)  # type: ignore[arg-type]
    with pytest.raises(AssertionError, match=r"does not hold within 0\.5 s"):
        network.advance_until(lambda: False, timeout=seconds(0.5))
    network.advance_until(lambda: len(network["b"].replicas) == 1, timeout=seconds(1))
