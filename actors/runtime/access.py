"""Who may use which key: the configuration of every Zenoh session and the rules that the router applies.

The world's session is the router; every other actor is a client that shows a user name and a password. The
router drops, without a word to the sender, whatever no rule allows. Its own session is not filtered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh

from actors.messages import AIRED, BOARD, CONTROL, RADIO_READY, RECEIVED, TRANSMIT, TRUTH
from actors.runtime import credentials
from actors.runtime.credentials import AccessError, Credentials, unix_endpoint, unnamed


@dataclass(frozen=True)
class Grant:
    """What one actor may do, as key expressions; a rule must include the whole key that is used."""

    publish: Sequence[str]
    subscribe: Sequence[str]
    receive: Sequence[str]
    """What it is sent; narrower than or equal to what it may subscribe to."""
    see_subscribers: Sequence[str]
    """Where it learns that somebody listens: a declared publisher stays mute where it does not."""


def robot_grant(robot: str) -> Grant:
    """A robot speaks on its own `up` keys and hears its own `down` keys."""
    up, down = f"swarm/up/{robot}/**", f"swarm/down/{robot}/**"
    return Grant(publish=[up], subscribe=[down], receive=[down], see_subscribers=["swarm/up/**"])


_EVERYTHING: Final = ["swarm/**"]
_OTHER_GRANTS: Final = {
    "radio": Grant(
        publish=[RECEIVED.key("*"), RADIO_READY.key(), AIRED.key(), BOARD.key()],
        subscribe=[TRANSMIT.key("*"), TRUTH.key()],
        receive=[TRANSMIT.key("*"), TRUTH.key()],
        see_subscribers=["swarm/down/**", "swarm/infra/**"],
    ),
    "observer": Grant(publish=[], subscribe=_EVERYTHING, receive=_EVERYTHING, see_subscribers=[]),
    "operator": Grant(
        publish=[CONTROL.key()],
        subscribe=_EVERYTHING,
        receive=_EVERYTHING,
        see_subscribers=["swarm/infra/**"],
    ),
}


def router_config(issued: Credentials, endpoints: Sequence[str] = ()) -> zenoh.Config:
    """The world's session: a router that listens for the actors and at `endpoints`.

    The actors find its sockets after `credentials.reveal` only.
    """
    sockets = dict.fromkeys(unix_endpoint(unnamed(socket)) for socket in issued.sockets.values())
    config = _config("router")
    _set(config, "listen/endpoints", [*sockets, *endpoints])
    # Without this the router sleeps half a second when it is opened.
    _set(config, "scouting/delay", 0)
    _set(config, "transport/auth/usrpwd", {"dictionary_file": str(issued.dictionary)})
    _set(config, "access_control", access_rules(issued.robots, issued.others))
    return config


def client_config(credentials_file: Path, endpoint: str) -> zenoh.Config:
    """The session of any other actor: it connects to `endpoint` and to nothing else.

    Raises AccessError where `credentials_file` cannot be read or does not hold `user:password`.
    """
    user, password = credentials.read(credentials_file)
    config = _config("client")
    _set(config, "connect/endpoints", [endpoint])
    _set(config, "listen/endpoints", [])
    _set(config, "transport/auth/usrpwd", {"user": user, "password": password})
    return config


def access_rules(robots: Sequence[str], others: Sequence[str]) -> dict[str, Any]:
    """Zenoh's `access_control` section: nothing passes but what the actors' grants allow.

    Raises AccessError for an actor that there is no grant for.
    """
    for other in others:
        if other not in _OTHER_GRANTS:
            raise AccessError(
                f"there are no access rules for {other!r}; there are for {', '.join(_OTHER_GRANTS)}"
            )
    grants = {robot: robot_grant(robot) for robot in robots}
    grants |= {other: _OTHER_GRANTS[other] for other in others}
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for actor, grant in grants.items():
        own = [
            _rule(f"{actor} publishes", "ingress", "put", grant.publish),
            _rule(f"{actor} subscribes", "ingress", "declare_subscriber", grant.subscribe),
            _rule(f"{actor} receives", "egress", "put", grant.receive),
            _rule(f"{actor} sees subscribers", "egress", "declare_subscriber", grant.see_subscribers),
        ]
        own = [rule for rule in own if rule["key_exprs"]]
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [actor]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": actor, "usernames": [actor]} for actor in grants],
        "policies": policies,
    }


def _rule(name: str, flow: str, message: str, keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": list(keys),
    }


def _config(mode: str) -> zenoh.Config:
    config = zenoh.Config()
    _set(config, "mode", mode)
    _set(config, "scouting/multicast/enabled", False)
    # Gossip would tell clients of each other, and they would connect past the rules.
    _set(config, "scouting/gossip/enabled", False)
    # Stamps would be the wall clock's, in recordings that have to be equal run for run.
    _set(config, "timestamping/enabled", False)
    _set(config, "transport/shared_memory/enabled", False)
    # Messages go out on the thread that sends them: two context switches fewer per step and robot. One
    # priority is enough, for the barrier has at most a handful of messages on a link.
    _set(config, "transport/unicast/lowlatency", True)
    _set(config, "transport/unicast/qos/enabled", False)
    return config


def _set(config: zenoh.Config, key: str, value: object) -> None:
    config.insert_json5(key, msgspec.json.encode(value).decode())
