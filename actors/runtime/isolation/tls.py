"""Mutual TLS between a robot's router and the operator's laptop: who may connect, and what it may do then.

Both show a certificate of the fleet's own authority, and the laptop's rights follow the common name in its
certificate. Actors on the robot itself go on using Unix sockets and passwords.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zenoh

from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import PRIVATE_KEY_FILE, Credentials
from actors.runtime.isolation.rules import (
    CERTIFIED,
    ON_THIS_MACHINE,
    OVER_TLS,
    Admitted,
    Grant,
    SessionParameters,
    access_rules,
    access_section,
    other_grant,
    robot_grant,
    router_config,
    session_config,
    set_value,
)

AUTHORITY_FILE: Final = "authority.pem"
"""Certificate of the fleet's authority."""
CERTIFICATE_FILE: Final = "certificate.pem"
"""The machine's own certificate."""
OPERATOR: Final = "operator"
"""Common name of the laptop that may watch, and stop the robots."""


@dataclass(frozen=True)
class TlsParameters:
    """How a router treats those who watch it over a network."""

    patience_us: int = 20_000
    """µs for which a message may wait for a link that takes nothing; then the link is closed. Default: own
    choice, the lateness that a robot's step may have. A laptop out of reach must not hold the robot up."""


@dataclass(frozen=True)
class Keys:
    """The files with which one machine proves who it is."""

    authority: Path
    certificate: Path
    private_key: Path

    @property
    def listening(self) -> dict[str, object]:
        """Zenoh's section for whoever is connected to."""
        return self._section("listen")

    @property
    def connecting(self) -> dict[str, object]:
        """The same for whoever connects."""
        return self._section("connect")

    def _section(self, role: str) -> dict[str, object]:
        return {
            "root_ca_certificate": str(self.authority),
            f"{role}_certificate": str(self.certificate),
            f"{role}_private_key": str(self.private_key),
            "enable_mtls": True,
        }


def admit_certified(issued: Credentials) -> None:
    """Let in whoever comes over TLS as CERTIFIED; to be called once."""
    with issued.dictionary.open("a", encoding="utf-8") as dictionary:
        dictionary.write(f"{CERTIFIED}:{CERTIFIED}\n")


def load_keys(folder: Path) -> Keys:
    """The keys in the folder of one machine. Raises AcrcError where one of the files is missing."""
    for name in (AUTHORITY_FILE, CERTIFICATE_FILE, PRIVATE_KEY_FILE):
        try:
            (folder / name).open("rb").close()
        except OSError as error:
            raise AcrcError(
                f"{folder / name} cannot be read ({error.strerror}); `acrc fleet keys` makes the keys of "
                "all machines, and this machine needs a copy of its own folder"
            ) from None
    return Keys(folder / AUTHORITY_FILE, folder / CERTIFICATE_FILE, folder / PRIVATE_KEY_FILE)


def listening_router_config(
    issued: Credentials,
    keys: Keys,
    endpoints: Sequence[str],
    certified: Sequence[str] = (OPERATOR,),
    parameters: TlsParameters = TlsParameters(),
) -> zenoh.Config:
    """The router's session, that besides access.router_config's listens at `endpoints`, `tls/HOST:PORT`.

    Whoever shows a certificate of the authority is let in, and may do what the access rules say of its common
    name if that is one of `certified`, else nothing. Adds a line to `issued.dictionary`, so call it once.
    """
    admit_certified(issued)
    config = router_config(issued, endpoints)
    set_value(
        config,
        "access_control",
        access_rules(issued.robots, issued.others, {name: other_grant(name) for name in certified}),
    )
    set_value(config, "transport/link/tls", keys.listening)
    # Low latency means to write on the thread that publishes: a laptop that stops reading would stop the
    # robot, without end. With a queue in between a full one holds it up for the patience, once.
    set_value(config, "transport/unicast/lowlatency", False)
    set_value(config, "transport/link/tx/lease", round(1000 * SessionParameters.lease_over_network_s))
    set_value(
        config,
        "transport/link/tx/queue/congestion_control/block/wait_before_close",
        parameters.patience_us,
    )
    return config


def onboard_router_config(issued: Credentials, keys: Path, listen: str | None) -> zenoh.Config:
    """The session of a robot's base: for a laptop, too, with the keys in the folder, if it is to listen."""
    if listen is None:
        return router_config(issued)
    return listening_router_config(issued, load_keys(keys), [listen])


def laptop_config(keys: Keys, endpoint: str) -> zenoh.Config:
    """The session of a laptop: it connects to a robot's `endpoint`, `tls/HOST:PORT`, and to nothing else.

    The robot's certificate must hold for HOST.
    """
    config = session_config("client", SessionParameters.lease_over_network_s)
    set_value(config, "connect/endpoints", [endpoint])
    set_value(config, "listen/endpoints", [])
    set_value(config, "transport/auth/usrpwd", {"user": CERTIFIED, "password": CERTIFIED})
    set_value(config, "transport/link/tls", keys.connecting)
    set_value(config, "transport/unicast/lowlatency", False)
    return config


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
