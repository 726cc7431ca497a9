"""A mesh over several computers: the world's router, and one router on each host for the robots there.

A host is a client of the world by mutual TLS, and has no more rights than its robots together. They go on
using Unix sockets and passwords, which are drawn on the host and never leave it.
"""

from dataclasses import dataclass
from typing import Final

import zenoh

from actors.runtime.access.credentials import Credentials
from actors.runtime.access.rules import (
    CERTIFIED,
    ON_THIS_MACHINE,
    OVER_TLS,
    Admitted,
    Grant,
    access_rules,
    access_section,
    robot_grant,
    router_config,
)
from actors.runtime.access.session_config import SessionParameters, set_value
from actors.runtime.access.tls import Keys, admit_certified, load_keys


@dataclass(frozen=True)
class HostLinkParameters:
    """How a step gets through a link between two computers.

    Zenoh writes to TLS and does not flush (1.10.2, seen with 60 robots on a host): where the socket takes no
    more for a moment the rest stays in TLS until somebody writes again, which nobody does, for all wait.
    """

    send_buffer: int = 4 << 20
    """Bytes that either end's socket is to take, for it to take a whole step; the system may give less. 60
    robots are sent 84 KB in a step, and answer with less."""
    push_s: float = 0.05
    """So often the world writes something all the same, s: a message of Zenoh's of some bytes, which takes
    along what has stayed. A host does not, for it would wake each of its robots up as often."""


_WORLD: Final = Grant(
    publish=["swarm/down/**"],
    subscribe=["swarm/**"],
    receive=["swarm/up/**"],
    see_subscribers=["swarm/down/**"],
)
"""What a host's router grants the world's: whatever its robots say and hear."""


def world_config(issued: Credentials) -> zenoh.Config:
    """The world's session, which lets hosts in if the run has any. To be called once.

    Raises AcrcError where a key is missing.
    """
    gate = issued.gate
    if gate is None:
        return router_config(issued)
    admit_certified(issued)
    config = router_config(issued, [gate.endpoint])
    hosts = {name: host_grant(robots) for name, robots in gate.robots.items()}
    set_value(config, "access_control", access_rules(issued.robots, issued.others, hosts))
    tls = load_keys(gate.keys).listening | {"so_sndbuf": HostLinkParameters.send_buffer}
    set_value(config, "transport/link/tls", tls)
    set_value(
        config, "transport/link/tx/keep_alive", round(SessionParameters.lease_s / HostLinkParameters.push_s)
    )
    return config


def host_config(issued: Credentials, keys: Keys, endpoint: str) -> zenoh.Config:
    """The session of a host: a router for the robots in `issued`, connected to the world's `endpoint`."""
    config = router_config(issued)
    set_value(config, "connect/endpoints", [endpoint])
    shown = {"dictionary_file": str(issued.dictionary), "user": CERTIFIED, "password": CERTIFIED}
    set_value(config, "transport/auth/usrpwd", shown)
    robots = [
        Admitted(robot, {"usernames": [robot], **ON_THIS_MACHINE}, robot_grant(robot))
        for robot in issued.robots
    ]
    set_value(config, "access_control", access_section([*robots, Admitted("world", OVER_TLS, _WORLD)]))
    tls = keys.connecting | {"so_sndbuf": HostLinkParameters.send_buffer}
    set_value(config, "transport/link/tls", tls)
    return config


def host_grant(robots: tuple[str, ...]) -> Grant:
    """What a host may do: speak and hear for these robots."""
    up = [f"swarm/up/{robot}/**" for robot in robots]
    down = [f"swarm/down/{robot}/**" for robot in robots]
    return Grant(publish=up, subscribe=down, receive=down, see_subscribers=["swarm/up/**"])
