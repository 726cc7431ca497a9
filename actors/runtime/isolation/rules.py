"""Configuration of every Zenoh session, and the access rules that the router applies.

The world's session is the router; every other actor is a client with a user name and a password. The router
silently drops whatever no rule allows. Its own session is not filtered.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import zenoh

from actors.messages import AIRED, BOARD, CONTROL, RADIO_READY, RECEIVED, TRANSMIT, TRUTH
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials
from actors.runtime.isolation.credentials import Credentials, unix_endpoint, unnamed


@dataclass(frozen=True)
class SessionParameters:
    """When a link counts as dead."""

    lease_s: float = 86_400.0
    """Silence after which the other end closes the link, s. Own choice: a day, for on one machine the end of
    a process closes its sockets, and silence means that it, or the machine, was stopped and may go on."""
    lease_over_network_s: float = 10.0
    """The same where the other end may be out of reach; Zenoh's default."""
    onlooker_s: float = 0.1
    """Longest wait of a message for an observer that takes nothing, s; then its link is closed, and it
    connects anew later. Own choice: a run is held up once, for the blink of an eye."""


def session_config(mode: str, lease_s: float = SessionParameters.lease_s) -> zenoh.Config:
    """Return a `router` or `client` without discovery, time stamps and shared memory."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        # Gossip would tell clients of each other, and they would connect past the rules.
        "scouting/gossip/enabled": False,
        # Stamps would be the wall clock's, in recordings that have to be equal run for run.
        "timestamping/enabled": False,
        "transport/shared_memory/enabled": False,
        # Messages go out on the thread that sends them: two context switches fewer per step and robot. One
        # priority is enough, for the barrier has at most a handful of messages on a link.
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        "transport/link/tx/lease": round(1000 * lease_s),
    }.items():
        set_value(config, key, value)
    return config


def set_value(config: zenoh.Config, key: str, value: object) -> None:
    """Set one key of the configuration, or a whole section."""
    config.insert_json5(key, msgspec.json.encode(value).decode())


CERTIFIED: Final = "certificate"
"""User and password of all that come over TLS: a router that asks some for passwords asks all. It is no
secret: no rule admits the user without a certificate."""
_LOCAL: Final[dict[str, Any]] = {"link_protocols": ["unixsock-stream"]}
OVER_TLS: Final[dict[str, Any]] = {"link_protocols": ["tls"]}


class Grant(NamedTuple):
    """What one actor may do, as key expressions; a rule must include the whole key that is used."""

    publish: Sequence[str]
    subscribe: Sequence[str]
    receive: Sequence[str]
    """Narrower than or equal to what it may subscribe to."""
    see_subscribers: Sequence[str]
    """Where it learns of subscribers: a declared publisher stays mute without one."""


def robots_grant(*robots: str) -> Grant:
    """Return the rights of robots: to publish on their own `up` keys, to receive on their own `down` keys."""
    down = [f"swarm/down/{robot}/**" for robot in robots]
    return Grant([f"swarm/up/{robot}/**" for robot in robots], down, down, ["swarm/up/**"])


_ALL: Final = ["swarm/**"]
_CLIENT_GRANTS: Final = {
    "radio": Grant(
        publish=[RECEIVED.key("*"), RADIO_READY.key(), AIRED.key(), BOARD.key()],
        subscribe=[TRANSMIT.key("*"), TRUTH.key()],
        receive=[TRANSMIT.key("*"), TRUTH.key()],
        see_subscribers=["swarm/down/**", "swarm/infra/**"],
    ),
    "observer": Grant(publish=[], subscribe=_ALL, receive=_ALL, see_subscribers=[]),
    "operator": Grant(
        publish=[CONTROL.key()], subscribe=_ALL, receive=_ALL, see_subscribers=["swarm/infra/**"]
    ),
}


def client_grant(actor: str) -> Grant:
    """Return the rights of a client that is no robot. Raises AcrcError."""
    if actor not in _CLIENT_GRANTS:
        raise AcrcError(f"there are no access rules for {actor!r}; there are for {', '.join(_CLIENT_GRANTS)}")
    return _CLIENT_GRANTS[actor]


class Admitted(NamedTuple):
    """Somebody whom a router lets in."""

    subject: str
    known_by: Mapping[str, Any]
    """As Zenoh's section has it."""
    grant: Grant


def certified(name: str, grant: Grant) -> Admitted:
    """Return the owner of a certificate with this common name; it shows the user CERTIFIED."""
    return Admitted(
        f"certified {name}", {"cert_common_names": [name], "usernames": [CERTIFIED], **OVER_TLS}, grant
    )


def router_config(
    issued: Credentials, endpoints: Sequence[str] = (), remote: Sequence[Admitted] = ()
) -> zenoh.Config:
    """Return the world's session: a router that listens for the actors and at `endpoints`.

    The actors find its sockets after `credentials.reveal` only. `remote`: who else is admitted, over TLS.
    """
    sockets = dict.fromkeys(unix_endpoint(unnamed(socket)) for socket in issued.sockets.values())
    config = session_config("router")
    set_value(config, "listen/endpoints", [*sockets, *endpoints])
    # Without this the router sleeps half a second when it is opened.
    set_value(config, "scouting/delay", 0)
    # For links with a queue, which observers have; the actors' have none, and take everything or block.
    wait_us = round(1e6 * SessionParameters.onlooker_s)
    set_value(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", wait_us)
    set_value(config, "transport/auth/usrpwd", {"dictionary_file": str(issued.dictionary)})
    set_value(config, "access_control", access_rules(issued.robots, issued.others, remote))
    return config


def client_config(credentials_file: Path, endpoint: str, *, onlooker: bool = False) -> zenoh.Config:
    """Return the session of any other actor, which connects to `endpoint` only.

    An `onlooker` may lose messages, and holds nobody up. Raises AcrcError where `credentials_file` cannot be
    read or does not hold `user:password`.
    """
    user, password = credentials.read(credentials_file)
    config = connecting_config(endpoint, user, password)
    if onlooker:  # then the router has a queue for it, and closes the link where that stays full
        set_value(config, "transport/unicast/lowlatency", False)
    return config


def connecting_config(
    endpoint: str, user: str, password: str, lease_s: float = SessionParameters.lease_s
) -> zenoh.Config:
    """Return a client that connects to `endpoint` and to nothing else."""
    config = session_config("client", lease_s)
    set_value(config, "connect/endpoints", [endpoint])
    set_value(config, "listen/endpoints", [])
    set_value(config, "transport/auth/usrpwd", {"user": user, "password": password})
    return config


def access_rules(
    robots: Sequence[str], others: Sequence[str], remote: Sequence[Admitted] = ()
) -> dict[str, Any]:
    """Return Zenoh's `access_control` section: nothing passes but what the actors' grants allow.

    `robots` and `others` are known by their user names. With anybody `remote`, a password counts on this
    machine's own sockets only. Raises AcrcError for an actor without a grant.
    """
    grants = {robot: robots_grant(robot) for robot in robots} | {name: client_grant(name) for name in others}
    here = _LOCAL if remote else {}
    local = [Admitted(name, {"usernames": [name], **here}, grant) for name, grant in grants.items()]
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for subject, _, grant in (*local, *remote):
        own = [
            _rule(f"{subject} publishes", "ingress", "put", grant.publish),
            _rule(f"{subject} subscribes", "ingress", "declare_subscriber", grant.subscribe),
            _rule(f"{subject} receives", "egress", "put", grant.receive),
            _rule(f"{subject} sees subscribers", "egress", "declare_subscriber", grant.see_subscribers),
        ]
        own = [rule for rule in own if rule["key_exprs"]]
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": subject, **known_by} for subject, known_by, _ in (*local, *remote)],
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
