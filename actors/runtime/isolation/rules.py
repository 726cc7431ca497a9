"""Who may use which key: the configuration of every Zenoh session and the rules that the router applies.

The world's session is the router; every other actor is a client that shows a user name and a password. The
router drops, without a word to the sender, whatever no rule allows. Its own session is not filtered.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
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
    """How long a message may wait for an observer that takes nothing, s; then its link is closed; it connects
    anew once it goes on. Own choice: a run is held up once, for the blink of an eye."""


def session_config(mode: str, lease_s: float = SessionParameters.lease_s) -> zenoh.Config:
    """A `router` or a `client` that looks for nobody, stamps nothing and shares no memory."""
    config = zenoh.Config()
    set_value(config, "mode", mode)
    set_value(config, "scouting/multicast/enabled", False)
    # Gossip would tell clients of each other, and they would connect past the rules.
    set_value(config, "scouting/gossip/enabled", False)
    # Stamps would be the wall clock's, in recordings that have to be equal run for run.
    set_value(config, "timestamping/enabled", False)
    set_value(config, "transport/shared_memory/enabled", False)
    # Messages go out on the thread that sends them: two context switches fewer per step and robot. One
    # priority is enough, for the barrier has at most a handful of messages on a link.
    set_value(config, "transport/unicast/lowlatency", True)
    set_value(config, "transport/unicast/qos/enabled", False)
    set_value(config, "transport/link/tx/lease", round(1000 * lease_s))
    return config


def set_value(config: zenoh.Config, key: str, value: object) -> None:
    """Set one key of the configuration, or a whole section."""
    config.insert_json5(key, msgspec.json.encode(value).decode())


CERTIFIED: Final = "certificate"
"""User and password of whoever comes over TLS, for a router that asks some for passwords asks all. It is no
secret: no rule knows the user without a certificate, so it opens nothing where there is none."""


ON_THIS_MACHINE: Final[dict[str, Any]] = {"link_protocols": ["unixsock-stream"]}
OVER_TLS: Final[dict[str, Any]] = {"link_protocols": ["tls"]}


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
    config = session_config("router")
    set_value(config, "listen/endpoints", [*sockets, *endpoints])
    # Without this the router sleeps half a second when it is opened.
    set_value(config, "scouting/delay", 0)
    # For links with a queue, which observers have; the actors' have none, and take everything or block.
    wait_us = round(1e6 * SessionParameters.onlooker_s)
    set_value(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", wait_us)
    set_value(config, "transport/auth/usrpwd", {"dictionary_file": str(issued.dictionary)})
    set_value(config, "access_control", access_rules(issued.robots, issued.others))
    return config


def client_config(credentials_file: Path, endpoint: str, *, onlooker: bool = False) -> zenoh.Config:
    """The session of any other actor: it connects to `endpoint` and to nothing else.

    An `onlooker` may lose messages, and holds nobody up.

    Raises AcrcError where `credentials_file` cannot be read or does not hold `user:password`.
    """
    user, password = credentials.read(credentials_file)
    config = session_config("client")
    set_value(config, "connect/endpoints", [endpoint])
    set_value(config, "listen/endpoints", [])
    set_value(config, "transport/auth/usrpwd", {"user": user, "password": password})
    if onlooker:  # then the router has a queue for it, and closes the link where that stays full
        set_value(config, "transport/unicast/lowlatency", False)
    return config


class Admitted(NamedTuple):
    """Somebody whom a router lets in."""

    subject: str
    known_by: dict[str, Any]
    """As Zenoh's section has it."""
    grant: Grant


def access_rules(
    robots: Sequence[str], others: Sequence[str], certified: Mapping[str, Grant] = MappingProxyType({})
) -> dict[str, Any]:
    """Zenoh's `access_control` section: nothing passes but what the actors' grants allow.

    `robots` and `others` are known by their user names, `certified` by the common names of their TLS
    certificates and the user CERTIFIED. Where anybody is certified a password counts on this machine's own
    sockets only, and a certificate adds nothing to it. Raises AcrcError for an actor without a grant.
    """
    here = ON_THIS_MACHINE if certified else {}
    admitted = [Admitted(robot, {"usernames": [robot], **here}, robot_grant(robot)) for robot in robots]
    admitted += [Admitted(other, {"usernames": [other], **here}, other_grant(other)) for other in others]
    for name, grant in certified.items():
        shown = {"cert_common_names": [name], "usernames": [CERTIFIED], **OVER_TLS}
        admitted.append(Admitted(f"certified {name}", shown, grant))
    return access_section(admitted)


def access_section(admitted: Sequence[Admitted]) -> dict[str, Any]:
    """Zenoh's `access_control` section: nothing passes but what these grants allow."""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for subject, _, grant in admitted:
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
        "subjects": [{"id": subject, **known_by} for subject, known_by, _ in admitted],
        "policies": policies,
    }


def other_grant(actor: str) -> Grant:
    """What one of the clients may do that are no robots. Raises AcrcError."""
    if actor not in _OTHER_GRANTS:
        raise AcrcError(f"there are no access rules for {actor!r}; there are for {', '.join(_OTHER_GRANTS)}")
    return _OTHER_GRANTS[actor]


def _rule(name: str, flow: str, message: str, keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": list(keys),
    }
