"""Authentication of packets: forgeries, relays, replays, and what remains possible without a key."""

from collections.abc import Iterator
from hashlib import sha256
from random import Random

import msgpack
import pytest
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import ECB
from hypothesis import given
from hypothesis import strategies as st

from deeco import Instant, Knowledge, component, milliseconds, role, seconds
from deeco.aes_ccm import TAG_SIZES, AesCcmAuthenticator
from deeco.errors import DeploymentError, ExecutionError
from deeco.fragments import Fragmenter, Reassembly
from deeco.link import LinkParameters, Reception
from deeco.network import NetworkParameters, RelayParameters
from deeco.node import Node
from deeco.packet import (
    KnowledgePacket,
    PacketAuthenticator,
    Version,
    increment_hops,
    pack,
    verified_packet,
)
from deeco.schema import RoleRegistry
from deeco.virtual_network import LossyMedium, VirtualNetwork
from tests.deeco.refusals import refused

KEY = bytes(range(16))
TAGS = AesCcmAuthenticator(KEY)
OTHER = AesCcmAuthenticator(bytes(16))
HUGE = 2**63
LONGEST = 2**64 - 1


@role
class Level(Knowledge):
    level: int = 0


@component
class Tank(Level):
    pass


REGISTRY = RoleRegistry((Level,))


def packet(
    name: str, epoch: int, counter: int, level: int = 0, tags: PacketAuthenticator | None = TAGS
) -> bytes:
    roles = REGISTRY.pack(Tank(id=name, level=level))
    return pack(KnowledgePacket(name, Version(epoch, counter), 0, roles), authenticator=tags)


def node(tags: PacketAuthenticator | None = TAGS, name: str = "me", **parameters: object) -> Node:
    return Node(
        [Tank(id=name)],
        parameters=NetworkParameters(authenticator=tags, **parameters),  # type: ignore[arg-type]
        address=9,
    )


def hear(listener: Node, *packets: bytes, every: float = 0.001) -> None:
    """Deliver packets of any length, one at a time."""
    fragmenter = Fragmenter(1)
    for data in packets:
        received = [Reception(listener.now, 1, frame, -60.0) for frame in fragmenter.frames([data])]
        listener.advance(Instant(listener.now + seconds(every)), received)


def counted(listener: Node) -> dict[str, int]:
    return dict(listener.outcome()["counters"])


def levels(listener: Node) -> dict[str, int]:
    return {one.id: one.role(Level).level for one in listener.replicas}


def reference_tag(key: bytes, content: bytes, size: int) -> bytes:
    """Compute the tag by NIST SP 800-38C, appendix A, from AES alone, for contents below 65280 bytes."""
    encryptor = Cipher(AES(key), ECB()).encryptor()
    nonce, header = sha256(content).digest()[:13], len(content).to_bytes(2, "big") + content
    flags = 64 + 8 * ((size - 2) // 2) + 1  # associated data, tag size, two bytes for the plaintext's length
    blocks = bytes([flags]) + nonce + bytes(2) + header + bytes(-len(header) % 16)
    state = bytes(16)
    for start in range(0, len(blocks), 16):
        mixed = bytes(a ^ b for a, b in zip(state, blocks[start : start + 16], strict=True))
        state = encryptor.update(mixed)
    mask = encryptor.update(bytes([1]) + nonce + bytes(2))
    return bytes(a ^ b for a, b in zip(state, mask, strict=True))[:size]


@pytest.mark.parametrize("size", TAG_SIZES)
def test_tags_are_those_of_ccm(size: int) -> None:
    random = Random(size)
    for length in (1, 13, 14, 15, 100, 1023):
        content = random.randbytes(length)
        assert AesCcmAuthenticator(KEY, size).tag(content) == reference_tag(KEY, content, size)
    plain, tagged = packet("a", 1, 2, tags=None), packet("a", 1, 2, tags=AesCcmAuthenticator(KEY, size))
    assert tagged[:-size] == plain and tagged[-size:] == reference_tag(KEY, plain, size)


@given(st.binary(max_size=300), st.sampled_from(TAG_SIZES))
def test_no_bytes_make_the_verification_raise(data: bytes, size: int) -> None:
    tags = AesCcmAuthenticator(KEY, size)
    assert verified_packet(data, tags) is None
    if data:
        tagged = data + tags.tag(bytes([data[0] & 0xF]) + data[1:])
        assert verified_packet(tagged, tags) == data
        assert verified_packet(increment_hops(tagged), tags) == increment_hops(data)


def forgeries() -> Iterator[bytes]:
    """Yield 10 000 packets without a valid tag, from real ones of the component `a` up to version (3, 40)."""
    random = Random(47)
    real = [packet("a", 3, counter, counter) for counter in range(1, 41)] + [packet("b", 3, 1)]
    for number in range(10_000):
        data = random.choice(real)
        body, tag = data[1:-8], data[-8:]
        position = random.randrange(1, len(data))
        yield (
            random.randbytes(random.randrange(1, 120)),
            data[:1] + random.randbytes(len(data) - 1),
            data[:position] + bytes([data[position] ^ 1 << random.randrange(8)]) + data[position + 1 :],
            bytes([data[0] ^ 1 << random.randrange(4)]) + data[1:],  # another type of packet
            data[:position],
            data + random.randbytes(8),
            packet("a", 3 + number, LONGEST - number, 99, OTHER),
            packet("a", LONGEST - number, 1, 99, None),
            packet("a", LONGEST - number, 1, 99, None) + tag,
            data[:1] + msgpack.packb(["ab"[data != real[-1]], *msgpack.unpackb(body)[1:]]) + tag,
            data[:1] + msgpack.packb(["me", *msgpack.unpackb(body)[1:]]) + tag,
            packet("a", 9, number, 99, AesCcmAuthenticator(KEY, 4)),
            packet("a", 9, number, 99, AesCcmAuthenticator(KEY, 16)),
        )[number % 13]


@pytest.mark.parametrize("relay", [None, RelayParameters()])
def test_none_of_10_000_forged_packets_is_accepted(relay: RelayParameters | None) -> None:
    listener = node(relay=relay)
    hear(listener, packet("a", 3, 41, 41))
    for data in forgeries():
        hear(listener, data, every=1e-6)
    counters = counted(listener)
    assert levels(listener) == {"a": 41} and counters["relayed"] == counters["relays_cancelled"] == 0
    assert counters["packets_forged"] == 10_000 and counters["packets"] == 10_001
    hear(listener, packet("a", 3, 42, 42))
    assert levels(listener) == {"a": 42}, "its real sender was not silenced"


def test_replayed_packets_are_old_whatever_their_hop_count() -> None:
    listener = node(forget_after=seconds(5))
    sent = [packet("a", 3, counter, counter) for counter in range(1, 41)]
    hear(listener, *sent)
    listener.advance(Instant(seconds(9)))
    listener.advance(Instant(seconds(10)))
    assert levels(listener) == {}
    hear(listener, *sent, *map(increment_hops, sent), every=0.1)
    counters = counted(listener)
    assert levels(listener) == {} and (counters["packets_old"], counters["packets_forged"]) == (80, 0)
    hear(listener, packet("a", 4, 1, 1))
    assert levels(listener) == {"a": 1}, "the sender is accepted after a restart"
    restarted = node()
    hear(restarted, *sent)
    assert levels(restarted) == {"a": 40}, "a node without versions accepts recorded packets in their order"


def line(tags: dict[str, PacketAuthenticator | None]) -> VirtualNetwork[Node]:
    """Return four nodes in a row, each within reach of its neighbours."""
    nodes = {
        name: Node(
            [Tank(id=name)],
            parameters=NetworkParameters(relay=RelayParameters(), authenticator=tags.get(name, TAGS)),
            address=number,
            publish_phase=milliseconds(70 * number),
        )
        for number, name in enumerate("abcd")
    }
    return VirtualNetwork(
        nodes, LossyMedium(reach=lambda one, other: -60.0 if abs(ord(one) - ord(other)) == 1 else None)
    )


def test_relayed_packets_are_accepted_unchanged_but_for_the_hops() -> None:
    network = line({})
    network.advance(seconds(6))
    assert {one.id: one.contact(network.now).hops for one in network["d"].replicas} == {
        "c": 0,
        "b": 1,
        "a": 2,
    }
    packets = [
        data
        for sender, frame in network.medium.sent
        for data in Reassembly().take(frame.instant, 1, frame.data)  # type: ignore[arg-type]
    ]
    assert {data[0] >> 4 for data in packets} == {0, 1, 2, 3}
    assert all(verified_packet(data, TAGS) is not None for data in packets)
    assert all(counted(one)["packets_forged"] == 0 for one in network.participants.values())


@pytest.mark.parametrize("stranger", [None, OTHER, AesCcmAuthenticator(KEY, 4)])
def test_nodes_of_different_keys_ignore_each_other(stranger: PacketAuthenticator | None) -> None:
    network = line({"b": stranger})
    network.advance(seconds(6))
    known = {name: [one.id for one in member.replicas] for name, member in network.participants.items()}
    assert known == {"a": [], "b": [], "c": ["d"], "d": ["c"]}
    refused_by = "packets_junk" if stranger is None else "packets_forged"
    assert counted(network["b"])[refused_by] > 10 and counted(network["a"])["packets_forged"] > 5


def test_a_packet_has_at_most_its_limit_with_its_tag() -> None:
    roles = REGISTRY.pack(Tank(id="a"))
    content = KnowledgePacket("a", Version(0, 1), 0, roles)
    size = len(pack(content))
    assert len(pack(content, LinkParameters(max_packet=size + 8), TAGS)) == size + 8
    with refused(
        f"the published knowledge of 'a' has {size + 8} bytes; "
        f"at most {size + 7} are allowed (LinkParameters.max_packet)",
        ExecutionError,
    ):
        pack(content, LinkParameters(max_packet=size + 7), TAGS)


def test_a_wrong_key_is_named_without_its_bytes() -> None:
    for key, size in ((b"secret", 8), (KEY, 5)):
        sentence = (
            f"AesCcmAuthenticator: the key has {len(key)} bytes and tag_size is {size}; "
            "use a key of 16 bytes and a tag_size of 4, 8 or 16"
        )
        with refused(sentence, DeploymentError):
            AesCcmAuthenticator(key, size)
    assert KEY.hex() not in repr(NetworkParameters(authenticator=TAGS)) and repr(KEY) not in repr(TAGS)


def silenced(*later: bytes) -> int:
    """Return how many seconds a node without key is silenced by a forged packet and `later` ones."""
    listener = node(None)
    hear(listener, packet("a", 3, 1, 1, None), packet("a", HUGE, 1, 99, None), every=1.0)
    hear(listener, *later)
    for second in range(1, 200):
        hear(listener, packet("a", 3, 1 + second, second, None), every=1.0)
        if levels(listener).get("a") == second:
            hear(listener, packet("a", 3, 2 + second, 1000, None))
            assert levels(listener)["a"] == 1000
            return second
    return 200


def test_without_a_key_one_forged_packet_silences_a_component_for_less_than_a_minute() -> None:
    assert silenced() == 47, "30 s until the replica is dropped, then 16 publications"
    assert silenced(packet("a", HUGE, 9, 99, None), packet("a", HUGE, 8, 99, None)) == 47


def test_a_forged_older_version_delays_the_end_of_the_silence_by_one_publication() -> None:
    listener = node(None, forget_after=seconds(5))
    hear(listener, packet("a", HUGE, 9, 99, None))
    listener.advance(Instant(seconds(10)))
    listener.advance(Instant(seconds(11)))
    hear(listener, packet("a", HUGE, 8, 99, None), packet("a", HUGE, 8, 99, None))
    hear(listener, *(packet("a", 3, second, second, None) for second in range(1, 17)), every=1.0)
    assert levels(listener) == {}
    hear(listener, packet("a", 3, 17, 17, None))
    assert levels(listener) == {"a": 17}


def test_nodes_of_one_process_share_decoded_frames_but_not_their_trust() -> None:
    frames = Fragmenter(1).frames([packet("a", 1, 1, 5, tags=None)])
    nodes = [
        Node([Tank(id=f"n{number}")], parameters=NetworkParameters(authenticator=tags), address=number)
        for number, tags in enumerate((None, None, TAGS, None))
    ]
    found = []
    for one in nodes:
        one.advance(Instant(1), [Reception(Instant(0), 1, frame, -60.0) for frame in frames])
        counts = counted(one)
        found.append((levels(one), counts["complete"], counts["packets"], counts["packets_forged"]))
    accepted = ({"a": 5}, 1, 1, 0)
    assert found == [accepted, accepted, ({}, 1, 1, 1), accepted]
