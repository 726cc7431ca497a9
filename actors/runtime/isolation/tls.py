"""Mutual TLS between computers: a robot's router and the operator's laptop, the world's router and its hosts.

Both ends show a certificate of one authority, and the rights follow the common name in it. Actors on the
router's computer use Unix sockets and passwords.
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
    OVER_TLS,
    Admitted,
    Grant,
    SessionParameters,
    certified,
    client_grant,
    connecting_config,
    robots_grant,
    router_config,
    set_value,
)

AUTHORITY_FILE: Final = "authority.pem"
"""Certificate of the fleet's authority."""
CERTIFICATE_FILE: Final = "certificate.pem"
"""The machine's own certificate."""
OPERATOR: Final = "operator"
"""Common name of the laptop that may watch, and stop the robots."""


@dataclass(frozen=True)
class TlsLinkParameters:
    """Links between two computers."""

    patience_us: int = 20_000
    """Longest wait of a robot's message for a laptop's link that takes nothing, µs; then the link is closed.
    Own choice, the lateness that a robot's step may have."""
    send_buffer: int = 4 << 20
    """Socket buffer of a host's link, bytes, for a whole step; the system may give less. 60 robots are sent
    84 KB in a step, and answer with less. Zenoh writes to TLS and does not flush (1.10.2, seen with 60 robots
    on a host): what the socket does not take at once stays in TLS until the next write, which never comes
    where all wait for one another."""
    push_s: float = 0.05
    """Interval, s, at which the world writes some bytes all the same, which takes along what has stayed. A
    host does not, for it would wake each of its robots up as often."""


@dataclass(frozen=True)
class Keys:
    """The files with which one machine proves its identity."""

    authority: Path
    certificate: Path
    private_key: Path

    @property
    def listening(self) -> dict[str, object]:
        """Zenoh's section of the side that is connected to."""
        return self._section("listen")

    @property
    def connecting(self) -> dict[str, object]:
        """Zenoh's section of the side that connects."""
        return self._section("connect")

    def _section(self, role: str) -> dict[str, object]:
        return {
            "root_ca_certificate": str(self.authority),
            f"{role}_certificate": str(self.certificate),
            f"{role}_private_key": str(self.private_key),
            "enable_mtls": True,
        }


def load_keys(folder: Path) -> Keys:
    """Return the keys in the folder of one machine. Raises AcrcError where one of the files is missing."""
    files = [folder / name for name in (AUTHORITY_FILE, CERTIFICATE_FILE, PRIVATE_KEY_FILE)]
    for file in files:
        try:
            file.open("rb").close()
        except OSError as error:
            raise AcrcError(
                f"{file} cannot be read ({error.strerror}); `acrc fleet keys` makes the keys of "
                "all machines, and this machine needs a copy of its own folder"
            ) from None
    return Keys(*files)


def listening_router_config(issued: Credentials, keys: Keys, endpoints: Sequence[str]) -> zenoh.Config:
    """Return the session of a robot's router, which listens for a laptop at `endpoints`, `tls/HOST:PORT`.

    Every certificate of the authority is let in, and all but OPERATOR's allow nothing. Adds a line to
    `issued.dictionary`, so call it once.
    """
    _admit_certified(issued)
    config = router_config(issued, endpoints, [certified(OPERATOR, client_grant(OPERATOR))])
    set_value(config, "transport/link/tls", keys.listening)
    # Low latency means to write on the thread that publishes: a laptop that stops reading would stop the
    # robot, without end. With a queue in between a full one holds it up for the patience, once.
    set_value(config, "transport/unicast/lowlatency", False)
    set_value(config, "transport/link/tx/lease", round(1000 * SessionParameters.lease_over_network_s))
    wait = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    set_value(config, wait, TlsLinkParameters.patience_us)
    return config


def _admit_certified(issued: Credentials) -> None:
    with issued.dictionary.open("a", encoding="utf-8") as dictionary:
        dictionary.write(f"{CERTIFIED}:{CERTIFIED}\n")


def onboard_router_config(issued: Credentials, keys: Path, listen: str | None) -> zenoh.Config:
    """Return the session of a robot's base; with `listen` for a laptop, too, with the keys in the folder."""
    if listen is None:
        return router_config(issued)
    return listening_router_config(issued, load_keys(keys), [listen])


def laptop_config(keys: Keys, endpoint: str) -> zenoh.Config:
    """Return the session of a laptop, which connects to a robot's `endpoint`, `tls/HOST:PORT`, only.

    The robot's certificate must be valid for HOST.
    """
    config = connecting_config(endpoint, CERTIFIED, CERTIFIED, SessionParameters.lease_over_network_s)
    set_value(config, "transport/link/tls", keys.connecting)
    set_value(config, "transport/unicast/lowlatency", False)
    return config


_WORLD: Final = Grant(
    publish=["swarm/down/**"],
    subscribe=["swarm/**"],
    receive=["swarm/up/**"],
    see_subscribers=["swarm/down/**"],
)
"""What a host's router grants the world's: all keys of its robots."""


def world_config(issued: Credentials) -> zenoh.Config:
    """Return the world's session, which lets hosts in if the run has any; call it once.

    Raises AcrcError where a key is missing.
    """
    gate = issued.gate
    if gate is None:
        return router_config(issued)
    _admit_certified(issued)
    hosts = [certified(name, robots_grant(*robots)) for name, robots in gate.robots.items()]
    config = router_config(issued, [gate.endpoint], hosts)
    tls = load_keys(gate.keys).listening | {"so_sndbuf": TlsLinkParameters.send_buffer}
    set_value(config, "transport/link/tls", tls)
    keep_alive = round(SessionParameters.lease_s / TlsLinkParameters.push_s)
    set_value(config, "transport/link/tx/keep_alive", keep_alive)
    return config


def host_config(issued: Credentials, keys: Keys, endpoint: str) -> zenoh.Config:
    """Return the session of a host: a router for its robots, connected to the world's `endpoint`."""
    config = router_config(issued, remote=[Admitted("world", OVER_TLS, _WORLD)])
    set_value(config, "connect/endpoints", [endpoint])
    users = {"dictionary_file": str(issued.dictionary), "user": CERTIFIED, "password": CERTIFIED}
    set_value(config, "transport/auth/usrpwd", users)
    set_value(config, "transport/link/tls", keys.connecting | {"so_sndbuf": TlsLinkParameters.send_buffer})
    return config
