"""What nodes send one another: the published knowledge of one component, in one version.

On the air (L2) a packet is one byte, its type in the low four bits and how often it has been relayed in the
high four, and a msgpack array: component's id, epoch, counter, and for each role fingerprint and fields.
"""

from collections.abc import Container
from typing import Any, Final, NamedTuple

import msgpack

from deeco.errors import ExecutionError
from deeco.knowledge import made
from deeco.link import DEFAULTS, LinkParameters
from deeco.on_air import text_size

_KNOWLEDGE: Final = 0
"""The type of packet, of three that JDEECo has (L2PacketType)."""
_MOST_HOPS: Final = 15
_HEAD: Final = 3
"""Items before the first role."""


class Version(NamedTuple):
    """How new knowledge is; compares as it should, so that a node that was restarted is heard again."""

    epoch: int
    """How often the component's node has been restarted."""
    counter: int
    """Publications in this epoch."""


class KnowledgePacket(NamedTuple):
    """One publication of one component."""

    component: str
    version: Version
    hops: int
    """How often it has been relayed."""
    roles: tuple[tuple[int, tuple[object, ...]], ...]
    """For each role that the component plays: the role's fingerprint and its packed fields."""


def pack(packet: KnowledgePacket, limits: LinkParameters = DEFAULTS) -> bytes:
    """The bytes of a packet. Raises ExecutionError if it or the component's id is too long."""
    if text_size(packet.component) > limits.most_id:
        raise ExecutionError(
            f"the id {packet.component!r} has {text_size(packet.component)} bytes in UTF-8; "
            f"at most {limits.most_id} go on the air (LinkParameters.most_id)"
        )
    body: list[object] = [packet.component, *packet.version]
    for role in packet.roles:
        body += role
    data = bytes([_KNOWLEDGE | min(packet.hops, _MOST_HOPS) << 4]) + bytes(msgpack.packb(body))
    if len(data) > limits.most_packet:
        raise ExecutionError(
            f"the published knowledge of {packet.component!r} has {len(data)} bytes; "
            f"at most {limits.most_packet} go on the air (LinkParameters.most_packet)"
        )
    return data


def _is_deeper(items: tuple[Any, ...], most: int) -> bool:
    """Are there tuples more than `most` deep? Without recursion, which somebody could drive too far."""
    level: list[Any] = [items]
    for _ in range(most):
        level = [item for inner in level for item in inner if type(item) is tuple]
        if not level:
            return False
    return True


class Unpacker:
    """Unpacks bytes from the air, of packets that relays repeat the head only.

    The fields of roles are bounded in number, size and nesting; a role book tells if they make sense.
    """

    def __init__(
        self, limits: LinkParameters = DEFAULTS, most: int = 128, known: Container[int] = ()
    ) -> None:
        """`most`: packets that are kept for repetitions, the last ones.

        `known`: fingerprints of roles whose nesting the role book checks, so that it is not checked here.
        """
        self._limits = limits
        self._known = known
        self._most = most
        self._kept: dict[bytes, KnowledgePacket] = {}
        self._bounds = {
            "max_array_len": max(limits.most_items, _HEAD + 2 * limits.most_roles),
            "max_str_len": max(limits.most_text, limits.most_id),
            "max_bin_len": limits.most_text,
            "max_map_len": 0,
            "max_ext_len": 0,
        }

    def unpack(self, data: bytes) -> KnowledgePacket | None:
        """Return the packet of bytes that may be anything; None if they are none. Never raises."""
        if not 0 < len(data) <= self._limits.most_packet or data[0] & 0xF != _KNOWLEDGE:
            return None
        body = data[1:]
        kept = self._kept.get(body)
        if kept is not None:
            return made(KnowledgePacket, (kept.component, kept.version, data[0] >> 4, kept.roles))
        packet = self._unpacked(body, data[0] >> 4)
        if packet is not None:
            self._kept[body] = packet
            if len(self._kept) > self._most:
                del self._kept[next(iter(self._kept))]
        return packet

    def _is_role(self, key: object, fields: object) -> bool:
        if type(key) is not int or not 0 <= key < 2**32 or type(fields) is not tuple:
            return False
        return key in self._known or not _is_deeper(fields, self._limits.most_depth + 1)

    def _unpacked(self, data: bytes, hops: int) -> KnowledgePacket | None:
        try:
            body = msgpack.unpackb(data, use_list=False, raw=False, strict_map_key=True, **self._bounds)
        except (ValueError, msgpack.UnpackException):  # ValueError: out of bounds, or text that is not UTF-8
            return None
        if type(body) is not tuple or (size := len(body)) < _HEAD or size % 2 != _HEAD % 2:
            return None
        component, epoch, counter, *rest = body
        if type(component) is not str or text_size(component) > self._limits.most_id:
            return None
        if not (type(epoch) is type(counter) is int and epoch >= 0 and counter >= 0):
            return None
        roles = (tuple(rest),) if size == _HEAD + 2 else tuple(zip(rest[::2], rest[1::2], strict=True))
        for key, fields in roles:
            if not self._is_role(key, fields):
                return None
        return made(KnowledgePacket, (component, made(Version, (epoch, counter)), hops, roles))


def relayed(data: bytes) -> bytes:
    """The same packet, relayed once more; beyond 15 times is not counted."""
    hops = min((data[0] >> 4) + 1, _MOST_HOPS)
    return bytes([data[0] & 0xF | hops << 4]) + data[1:]
