"""Encoding of roles on the link: field values in order, without names and without the id.

Nodes that know a role by the same fingerprint use the same encoding, as nodes of one program do.
"""

from collections.abc import Container, Iterable
from functools import lru_cache
from hashlib import blake2b
from typing import Any, NamedTuple

from deeco.encoding import (
    Compiler,
    MalformedDataError,
    Resolution,
    UnencodableTypeError,
    UnencodableValueError,
    class_decoder,
    expressions,
)
from deeco.errors import DeploymentError, ExecutionError
from deeco.history import histories, published_fields
from deeco.knowledge import Knowledge, is_role, new_tuple, roles_of
from deeco.link import DEFAULTS, LinkParameters

__all__ = ["MalformedDataError", "Resolution", "RoleRegistry", "UnpackedRoles"]

_ID = "id"
_MOST_UNPACKED = 128
"""Packets whose decoded roles are cached: among nodes of one process, each is decoded once."""


class UnpackedRoles(NamedTuple):
    """Decoded roles of one packet."""

    roles: tuple[Knowledge, ...]
    unknown: int
    """Number of roles that are not in the registry."""


class _Role:
    """One role with its compiled codecs.

    `fingerprint`: 32-bit hash of the role's qualified name (without its module), the names and order of its
    fields and their types. It is equal in all processes.
    """

    def __init__(self, cls: type[Knowledge], limits: LinkParameters) -> None:
        if not is_role(cls):
            raise DeploymentError(f"{cls.__name__} cannot be published: decorate its class with @role")
        self.cls = cls
        names = tuple(name for name in published_fields(cls) if name != _ID)
        past = histories(cls)
        try:
            codecs = Compiler(limits, inside=(cls,)).fields(cls, names)
            values = {
                _ID: _ID,
                **dict(zip(names, expressions(codecs), strict=True)),
                **dict.fromkeys(past, "()"),
            }
            self.unpack = class_decoder(cls, values, codecs)
        except UnencodableTypeError as unsound:
            raise DeploymentError(f"role {cls.__name__} cannot be published: {unsound}") from None
        depth = max((codec.depth for codec in codecs), default=0)
        if depth > limits.max_depth:
            raise DeploymentError(
                f"role {cls.__name__} cannot be published: its types are nested {depth} levels deep; "
                f"at most {limits.max_depth} are allowed (LinkParameters.max_depth)"
            )
        self._names = names
        self._pack = tuple(codec.pack for codec in codecs)
        fields = ",".join(f"{name}:{codec.signature}" for name, codec in zip(names, codecs, strict=True))
        self.signature = f"{cls.__qualname__}({fields})"
        self.fingerprint = int.from_bytes(blake2b(self.signature.encode(), digest_size=4).digest(), "little")

    def pack(self, value: Knowledge) -> tuple[Any, ...]:
        """Return the encoded fields. Raises ExecutionError for a value that cannot be encoded."""
        packed: list[Any] = []
        try:
            for pack, name in zip(self._pack, self._names, strict=True):
                packed.append(pack(getattr(value, name)))
        except UnencodableValueError as unfit:
            raise ExecutionError(
                f"{self.cls.__name__}.{name} of {value.id!r} cannot be published: {unfit}"
            ) from None
        return tuple(packed)


class RoleRegistry:
    """Codecs of the roles of a node.

    Raises DeploymentError for a role that cannot be encoded and for two roles of one fingerprint.
    """

    def __init__(self, roles: Iterable[type[Knowledge]], limits: LinkParameters = DEFAULTS) -> None:
        self._by_fingerprint: dict[int, _Role] = {}
        self._by_class: dict[type[Knowledge], _Role] = {}
        self._played: dict[type[Knowledge], tuple[_Role, ...]] = {}
        self._limits = limits
        self.nodes: set[int] = set()
        """Addresses of the nodes with this registry; if there are several, decoded roles are cached."""
        self._unpacked: dict[tuple[str, int], tuple[object, UnpackedRoles]] = {}
        """Last valid packets, with their encoded roles."""
        for cls in roles:
            if cls not in self._by_class:
                self._add(_Role(cls, limits))

    def _add(self, role: _Role) -> None:
        other = self._by_fingerprint.setdefault(role.fingerprint, role)
        if other is not role:
            raise DeploymentError(
                f"{_place(role.cls)} and {_place(other.cls)} have the same fingerprint, "
                f"{role.fingerprint:08x}; rename one of them"
            )
        self._by_class[role.cls] = role

    @property
    def has_histories(self) -> bool:
        """True if a role in the registry has histories."""
        return any(histories(cls) for cls in self._by_class)

    @property
    def fingerprints(self) -> Container[int]:
        """Fingerprints of the roles in the registry."""
        return self._by_fingerprint

    def pack(self, value: Knowledge) -> tuple[tuple[int, tuple[object, ...]], ...]:
        """Return the fingerprint and encoded fields of each role that a component plays.

        Raises ExecutionError for a value that cannot be encoded, DeploymentError for an unknown role.
        """
        kind = type(value)
        played = self._played.get(kind)
        if played is None:
            played = self._played[kind] = self._roles_of(kind)
        return tuple([(role.fingerprint, role.pack(value)) for role in played])

    def _roles_of(self, kind: type[Knowledge]) -> tuple[_Role, ...]:
        roles = roles_of(kind)
        if missing := next((one for one in roles if one not in self._by_class), None):
            raise DeploymentError(
                f"{kind.__name__} plays {missing.__name__}, which is not in the role registry"
            )
        if len(roles) > self._limits.max_roles:
            raise DeploymentError(
                f"{kind.__name__} plays {len(roles)} roles; at most {self._limits.max_roles} are allowed "
                "(LinkParameters.max_roles)"
            )
        return tuple(self._by_class[one] for one in roles)

    def unpack(
        self, component: str, packed: tuple[tuple[int, tuple[object, ...]], ...]
    ) -> UnpackedRoles | None:
        """Return the component's known roles in order of arrival; None if the packet is invalid.

        A packet is invalid if it repeats a role or if a role's fields do not match its encoding exactly.
        """
        is_shared = len(self.nodes) > 1
        place = component, id(packed)
        if is_shared and place in self._unpacked and self._unpacked[place][0] is packed:
            return self._unpacked[place][1]
        found: dict[int, Knowledge] = {}
        try:
            for key, fields in packed:
                role = self._by_fingerprint.get(key)
                if key in found:
                    return None
                if role is not None:
                    found[key] = role.unpack(fields, component)
        except MalformedDataError:
            return None
        unpacked = new_tuple(UnpackedRoles, (tuple(found.values()), len(packed) - len(found)))
        if is_shared:
            if len(self._unpacked) >= _MOST_UNPACKED:
                del self._unpacked[next(iter(self._unpacked))]
            self._unpacked[place] = packed, unpacked
        return unpacked


@lru_cache(maxsize=16)
def shared_registry(roles: tuple[type[Knowledge], ...], limits: LinkParameters) -> RoleRegistry:
    """Return the registry of all nodes of this process with these roles, so that roles are compiled once."""
    return RoleRegistry(roles, limits)


def _place(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"
