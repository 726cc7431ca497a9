"""Packets of nodes (L2): the published knowledge of one component in one version.

A packet is one byte, its type in the low four bits and its hop count in the high four, and a msgpack array:
component id, epoch, counter, and for each role its fingerprint and fields. An authenticated packet ends with
a tag of everything but the hop count, which relays change.
"""

from collections.abc import Container, Sequence
from functools import partial
from hmac import compare_digest
from typing import Any, Final, NamedTuple, Protocol

import msgpack

from deeco.encoding import text_size
from deeco.errors import ExecutionError
from deeco.knowledge import new_tuple
from deeco.link import DEFAULTS, LinkParameters

_KNOWLEDGE: Final = 0
"""Packet type; JDEECo has three (L2PacketType)."""
_MAX_HOPS: Final = 15
_HEAD: Final = 3
"""Items before the first role."""


class PacketAuthenticator(Protocol):
    """Keyed function for the tags of packets; `deeco.aes_ccm` has an implementation."""

    @property
    def tag_size(self) -> int:
        """Bytes of a tag, at least 1."""

    def tag(self, content: bytes) -> bytes:
        """Return the tag of a content; equal for equal contents."""


class Version(NamedTuple):
    """Version of a component's knowledge; compares by epoch first, so that a restarted node is accepted."""

    epoch: int
    """Number of restarts of the component's node."""
    counter: int
    """Number of publications in this epoch."""


class KnowledgePacket(NamedTuple):
    """One publication of one component."""

    component: str
    version: Version
    hops: int
    """Number of relays so far."""
    roles: tuple[tuple[int, tuple[object, ...]], ...]
    """Fingerprint and encoded fields of each role that the component plays."""


FramePackets = Sequence[tuple[bytes, KnowledgePacket]]
"""Packets of a frame: the bytes and the content of each."""


def pack(
    packet: KnowledgePacket,
    limits: LinkParameters = DEFAULTS,
    authenticator: PacketAuthenticator | None = None,
) -> bytes:
    """Return the bytes of a packet. Raises ExecutionError if the packet or the component's id is too long."""
    if text_size(packet.component) > limits.max_id:
        raise ExecutionError(
            f"the id {packet.component!r} has {text_size(packet.component)} bytes in UTF-8; "
            f"at most {limits.max_id} are allowed (LinkParameters.max_id)"
        )
    body: list[object] = [packet.component, *packet.version]
    for role in packet.roles:
        body += role
    data = bytes([_KNOWLEDGE | min(packet.hops, _MAX_HOPS) << 4]) + bytes(msgpack.packb(body))
    if authenticator is not None:
        data += _tag(data, authenticator)
    if len(data) > limits.max_packet:
        raise ExecutionError(
            f"the published knowledge of {packet.component!r} has {len(data)} bytes; "
            f"at most {limits.max_packet} are allowed (LinkParameters.max_packet)"
        )
    return data


def verified_packet(data: bytes, authenticator: PacketAuthenticator) -> bytes | None:
    """Return the packet without its tag; None if the tag of `data` (untrusted) is wrong. Never raises."""
    size = authenticator.tag_size
    content, tag = data[:-size], data[-size:]
    return content if content and compare_digest(tag, _tag(content, authenticator)) else None


def _tag(content: bytes, authenticator: PacketAuthenticator) -> bytes:
    return authenticator.tag(bytes([content[0] & 0xF]) + content[1:])


def _is_deeper(items: tuple[Any, ...], most: int) -> bool:
    """Return whether tuples are nested more than `most` deep; iterative, as the input is untrusted."""
    level: list[Any] = [items]
    for _ in range(most):
        level = [item for inner in level for item in inner if type(item) is tuple]
        if not level:
            return False
    return True


class Unpacker:
    """Decodes packets; of repeated packets, only the first byte.

    Bounds number, size and nesting of role fields; a role registry checks their meaning.
    """

    def __init__(
        self, limits: LinkParameters = DEFAULTS, most: int = 128, known: Container[int] = ()
    ) -> None:
        """Create an unpacker that caches the last `most` packets.

        `known`: fingerprints of roles whose nesting the role registry checks; it is not checked here.
        """
        self._limits = limits
        self._known = known
        self._most = most
        self._cache: dict[bytes, KnowledgePacket] = {}
        self.frames: dict[bytes, FramePackets] = {}
        """Frames of one valid packet each, without tag, that nodes of one process have received."""
        self._unpack = partial(
            msgpack.unpackb,
            use_list=False,
            max_array_len=max(limits.max_items, _HEAD + 2 * limits.max_roles),
            max_str_len=max(limits.max_text, limits.max_id),
            max_bin_len=limits.max_text,
            max_map_len=0,
            max_ext_len=0,
        )

    def unpack(self, data: bytes) -> KnowledgePacket | None:
        """Return the packet; None if `data` (untrusted) is not a valid packet. Never raises."""
        if not data or (head := data[0]) & 0xF != _KNOWLEDGE:
            return None
        body, hops = data[1:], head >> 4
        packet = self._cache.get(body)
        if packet is None:
            packet = self._decode(body, hops) if len(data) <= self._limits.max_packet else None
            if packet is None:
                return None
            if len(self._cache) >= self._most:
                del self._cache[next(iter(self._cache))]
        elif packet.hops == hops:
            return packet
        else:
            packet = new_tuple(KnowledgePacket, (packet.component, packet.version, hops, packet.roles))
        self._cache[body] = packet
        return packet

    def _decode(self, data: bytes, hops: int) -> KnowledgePacket | None:
        try:
            body = self._unpack(data)
        except (ValueError, msgpack.UnpackException):  # ValueError: out of bounds, or text that is not UTF-8
            return None
        if type(body) is not tuple or (size := len(body)) < _HEAD or size % 2 != _HEAD % 2:
            return None
        component, version, rest = body[0], body[1:_HEAD], body[_HEAD:]
        epoch, counter = version
        is_version = type(epoch) is type(counter) is int and epoch >= 0 and counter >= 0
        if not is_version or type(component) is not str or text_size(component) > self._limits.max_id:
            return None
        roles = (rest,) if len(rest) == 2 else tuple(zip(rest[::2], rest[1::2], strict=True))
        for key, fields in roles:
            if type(key) is not int or not 0 <= key < 2**32 or type(fields) is not tuple:
                return None
            if key not in self._known and _is_deeper(fields, self._limits.max_depth + 1):
                return None
        return new_tuple(KnowledgePacket, (component, new_tuple(Version, version), hops, roles))


def increment_hops(data: bytes) -> bytes:
    """Return the packet with its hop count increased by one, up to 15."""
    hops = min((data[0] >> 4) + 1, _MAX_HOPS)
    return bytes([data[0] & 0xF | hops << 4]) + data[1:]
