"""zenoh-ros2-sdk with the definitions of the tests instead of downloads."""

import os
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import _cache, message_registry, session
from zenoh_ros2_sdk.utils import get_type_hash

from tests.ros2.definitions import FIELDS, definition, parts, write_definitions

_FAST_RETRY = "connect/retry={period_init_ms: 100, period_max_ms: 200, period_increase_factor: 1}"
"""Instead of up to 4 s between attempts to connect, as in rmw_zenoh."""


def _refuse_download(*words: object, **named: object) -> None:
    raise AssertionError(f"the SDK was about to download {words} {named}")


def use_own_definitions(folder: Path) -> None:
    """Let the SDK read message definitions from `folder`, which is filled, and refuse to download others."""
    write_definitions(folder)
    message_registry._registry = message_registry.MessageRegistry(str(folder))
    for module in (_cache, message_registry):
        module.clone_to_cache = _refuse_download
        module.get_message_file_path = _refuse_download


def sdk_type_hash(kind: str) -> str:
    """Return the type hash as the SDK computes it, by its own code."""
    dependencies = {one: definition(one) for one in FIELDS if one != kind}
    found: str = get_type_hash(kind, msg_definition=definition(kind), dependencies=dependencies)
    return found


def message(store: Any, kind: str, fields: dict[str, Any]) -> Any:
    """Return a message of the SDK's store from nested dictionaries and lists."""
    values = {}
    for line in FIELDS[kind]:
        name, base, length = parts(kind, line)
        value = fields[name]
        if "/" in base:
            nested = [message(store, base, one) for one in (value if length is not None else [value])]
            value = nested[0] if length is None else nested
        values[name] = value
    return store.types[kind](**values)


def sdk_store() -> Any:
    """Return a store of all types as the SDK's session registers them, without a session."""
    bare = object.__new__(session.ZenohSession)
    bare.store, bare._registered_types = get_typestore(Stores.EMPTY), {}
    for kind in FIELDS:
        bare.register_message_type(definition(kind), kind)
    return bare.store


def sdk_session(port: int) -> Any:
    """Return the SDK's only session of this process, connected to a router on 127.0.0.1."""
    os.environ["ZENOH_CONFIG_OVERRIDE"] = _FAST_RETRY
    return session.ZenohSession.get_instance("127.0.0.1", port)
