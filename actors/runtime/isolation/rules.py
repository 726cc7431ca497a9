"""Configuration of Zenoh sessions, and the router's access rules.

The world's session is the router; every other actor is a client with user name and password. The router
silently drops messages that no rule allows. Its own session is not filtered.
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
from actors.runtime.isolation.credentials import Credentials, hidden_path, unix_endpoint


@dataclass(frozen=True)
class SessionParameters:
    """Timeouts of links."""

    lease_s: float = 86_400.0
    """Silence after which a peer closes the link, s. Own choice: a day. On one machine the sockets close when
    a process exits; a silent process, or the machine, was stopped and may continue."""
    lease_over_network_s: float = 10.0
    """The same for links over a network; Zenoh's default."""
    observer_timeout_s: float = 0.1
    """Longest wait for an observer that reads nothing, s; then its link is closed, and it reconnects. Own
    choice: it delays a run once, hardly noticeably."""


def session_config(mode: str, lease_s: float = SessionParameters.lease_s) -> zenoh.Config:
    """Return the configuration of a `router` or `client` without discovery, timestamps and shared memory."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        # Gossip would let clients connect to each other and bypass the rules.
        "scouting/gossip/enabled": False,
        # Wall-clock timestamps would make recordings of equal runs differ.
        "timestamping/enabled": False,
        "transport/shared_memory/enabled": False,
        # Sending on the publishing thread saves two context switches per step and robot. One priority
        # suffices: the barrier has few messages per link.
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        "transport/link/tx/lease": round(1000 * lease_s),
    }.items():
        set_value(config, key, value)
    return config


def set_value(config: zenoh.Config, key: str, value: object) -> None:
    """Set a key of the configuration, or a whole section."""
    config.insert_json5(key, msgspec.json.encode(value).decode())


CERTIFIED: Final = "certificate"
"""User and password of all TLS clients: a router requires passwords from all clients or none. Not a secret:
the rules admit this user only with a certificate."""
_LOCAL: Final[dict[str, Any]] = {"link_protocols": ["unixsock-stream"]}
OVER_TLS: Final[dict[str, Any]] = {"link_protocols": ["tls"]}


class Grant(NamedTuple):
    """Permissions of one actor, as key expressions; a rule must include the whole key that is used."""

    publish: Sequence[str]
    subscribe: Sequence[str]
    receive: Sequence[str]
    """Equal to or narrower than `subscribe`."""
    see_subscribers: Sequence[str]
    """Keys whose subscribers it sees: a declared publisher sends nothing without a known subscriber."""


def robots_grant(*robots: str) -> Grant:
    """Return the permissions of robots: publish on their own `up` keys, receive on their own `down` keys."""
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
    """Return the permissions of a client other than a robot. Raises AcrcError."""
    if actor not in _CLIENT_GRANTS:
        raise AcrcError(f"no access rules for {actor!r}; known clients: {', '.join(_CLIENT_GRANTS)}")
    return _CLIENT_GRANTS[actor]


class AdmittedClient(NamedTuple):
    """A client that a router admits."""

    subject: str
    known_by: Mapping[str, Any]
    """The client's properties, as in Zenoh's section."""
    grant: Grant


def certified_client(name: str, grant: Grant) -> AdmittedClient:
    """Return the client that has a certificate with this common name and the user CERTIFIED."""
    return AdmittedClient(
        f"certified {name}", {"cert_common_names": [name], "usernames": [CERTIFIED], **OVER_TLS}, grant
    )


def router_config(
    issued: Credentials, endpoints: Sequence[str] = (), remote: Sequence[AdmittedClient] = ()
) -> zenoh.Config:
    """Return the configuration of the world's session: a router with the actors' sockets and `endpoints`.

    Actors see the sockets after `credentials.publish_sockets`. `remote`: clients admitted over TLS.
    """
    sockets = dict.fromkeys(unix_endpoint(hidden_path(socket)) for socket in issued.sockets.values())
    config = session_config("router")
    set_value(config, "listen/endpoints", [*sockets, *endpoints])
    # Without this, opening the router takes half a second longer.
    set_value(config, "scouting/delay", 0)
    # For links with a queue, which only observers have; those of actors have none and block.
    wait_us = round(1e6 * SessionParameters.observer_timeout_s)
    set_value(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", wait_us)
    set_value(config, "transport/auth/usrpwd", {"dictionary_file": str(issued.dictionary)})
    set_value(config, "access_control", access_rules(issued.robots, issued.others, remote))
    return config


def client_config(credentials_file: Path, endpoint: str, *, lossy: bool = False) -> zenoh.Config:
    """Return the configuration of any other actor's session, which connects to `endpoint` only.

    A `lossy` client may lose messages and blocks no sender. Raises AcrcError if `credentials_file` is
    unreadable or does not contain `user:password`.
    """
    user, password = credentials.read(credentials_file)
    config = connecting_config(endpoint, user, password)
    if lossy:  # gets a queue in the router, which closes the link if it stays full
        set_value(config, "transport/unicast/lowlatency", False)
    return config


def connecting_config(
    endpoint: str, user: str, password: str, lease_s: float = SessionParameters.lease_s
) -> zenoh.Config:
    """Return the configuration of a client that connects to `endpoint` only."""
    config = session_config("client", lease_s)
    set_value(config, "connect/endpoints", [endpoint])
    set_value(config, "listen/endpoints", [])
    set_value(config, "transport/auth/usrpwd", {"user": user, "password": password})
    return config


def access_rules(
    robots: Sequence[str], others: Sequence[str], remote: Sequence[AdmittedClient] = ()
) -> dict[str, Any]:
    """Return Zenoh's `access_control` section: the actors' grants, everything else denied.

    `robots` and `others` are identified by user name. With any `remote` client, passwords are valid on local
    sockets only. Raises AcrcError for an actor without a grant.
    """
    grants = {robot: robots_grant(robot) for robot in robots} | {name: client_grant(name) for name in others}
    here = _LOCAL if remote else {}
    local = [AdmittedClient(name, {"usernames": [name], **here}, grant) for name, grant in grants.items()]
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
