"""Mutual TLS between computers: a robot's router and an operator station, the world's router and its hosts.

Both ends present certificates of one authority; the common name determines the permissions. Actors on the
router's computer use Unix sockets and passwords.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zenoh

from actors.runtime.codec import MESSAGE_LIMIT
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import PRIVATE_KEY_FILE, Credentials
from actors.runtime.isolation.rules import (
    CERTIFIED,
    OVER_TLS,
    AdmittedClient,
    Grant,
    SessionParameters,
    certified_client,
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
"""Common name of the operator station, which may observe and stop the robots."""


RADIO_STATION: Final = "radio"
"""Name of the keys of the computer with the simulated radio medium."""


_WAIT: Final = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_MESSAGE_SIZE: Final = "transport/link/rx/max_message_size"


@dataclass(frozen=True)
class TlsLinkParameters:
    """Parameters of links between computers."""

    patience_us: int = 20_000
    """Longest wait of a robot's message for a blocked operator link, µs; then the link is closed. Own choice:
    the permitted lateness of a robot's step."""
    send_buffer: int = 4 << 20
    """Socket buffer of a host's link, bytes, for a whole step; the system may grant less. 60 robots receive
    84 KB per step and send less. Zenoh writes to TLS without flushing (1.10.2, observed with 60 robots on a
    host): data that the socket does not accept stays in TLS until the next write, which never happens if all
    processes wait for each other."""
    push_s: float = 0.05
    """Interval at which the world writes a few bytes to push out data left in TLS, s. A host does not, since
    that would wake each of its robots as often."""


@dataclass(frozen=True)
class Keys:
    """Key files that prove the identity of one machine."""

    authority: Path
    certificate: Path
    private_key: Path

    @property
    def listening(self) -> dict[str, object]:
        """Zenoh's section for the listening side."""
        return self._section("listen")

    @property
    def connecting(self) -> dict[str, object]:
        """Zenoh's section for the connecting side."""
        return self._section("connect")

    def _section(self, role: str) -> dict[str, object]:
        return {
            "root_ca_certificate": str(self.authority),
            f"{role}_certificate": str(self.certificate),
            f"{role}_private_key": str(self.private_key),
            "enable_mtls": True,
        }


def load_keys(folder: Path) -> Keys:
    """Return the keys in one machine's folder. Raises AcrcError if a file is missing."""
    files = [folder / name for name in (AUTHORITY_FILE, CERTIFICATE_FILE, PRIVATE_KEY_FILE)]
    for file in files:
        try:
            file.open("rb").close()
        except OSError as error:
            raise AcrcError(
                f"{file} cannot be read ({error.strerror}); create the keys of all machines with "
                "`acrc fleet keys`, and copy this machine's folder to it"
            ) from None
    return Keys(*files)


def listening_router_config(
    issued: Credentials, keys: Keys, endpoints: Sequence[str], robots: Sequence[str] = ()
) -> zenoh.Config:
    """Return the configuration of a robot's router that listens for an operator at `tls/HOST:PORT`.

    It admits every certificate of the authority, but only OPERATOR's has permissions. With `robots` it is the
    router of a simulated radio medium: each of these has access to its own keys. Appends a line to
    `issued.dictionary`: call it once.
    """
    _admit_certified(issued)
    clients = [certified_client(robot, robots_grant(robot)) for robot in robots]
    operator = certified_client(OPERATOR, client_grant(OPERATOR))
    config = router_config(issued, endpoints, clients or [operator])
    set_value(config, _MESSAGE_SIZE, MESSAGE_LIMIT)
    set_value(config, "transport/link/tls", keys.listening)
    # Low latency would write on the publishing thread: an operator station that stops reading would stop the
    # robot forever. With a queue it delays the robot once, by `patience_us`.
    set_value(config, "transport/unicast/lowlatency", False)
    set_value(config, "transport/link/tx/lease", round(1000 * SessionParameters.lease_over_network_s))
    set_value(config, _WAIT, TlsLinkParameters.patience_us)
    return config


def medium_client_config(keys: Keys, endpoint: str) -> zenoh.Config:
    """Return the configuration of a robot's link to the simulated radio medium at `tls/HOST:PORT`.

    Unlike a client's, such a session opens without the other side, and connects whenever that listens.
    """
    config = laptop_config(keys, endpoint)
    for key, value in {
        "mode": "peer",
        "scouting/delay": 0,
        "connect/retry": {"period_init_ms": 1000, "period_max_ms": 1000, "period_increase_factor": 1},
        _WAIT: TlsLinkParameters.patience_us,
        _MESSAGE_SIZE: MESSAGE_LIMIT,
    }.items():
        set_value(config, key, value)
    return config


def _admit_certified(issued: Credentials) -> None:
    with issued.dictionary.open("a", encoding="utf-8") as dictionary:
        dictionary.write(f"{CERTIFIED}:{CERTIFIED}\n")


def onboard_router_config(issued: Credentials, keys: Path, listen: str | None) -> zenoh.Config:
    """Return the configuration of a base's router; with `listen`, for an operator, too, with these keys."""
    if listen is None:
        return router_config(issued)
    return listening_router_config(issued, load_keys(keys), [listen])


def laptop_config(keys: Keys, endpoint: str) -> zenoh.Config:
    """Return the configuration of an operator station, which connects only to a robot's `tls/HOST:PORT`.

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
"""Permissions of the world's router at a host's router: all keys of its robots."""


def world_config(issued: Credentials) -> zenoh.Config:
    """Return the configuration of the world's session, which admits hosts if the run has any; call it once.

    Raises AcrcError if a key is missing.
    """
    gate = issued.gate
    if gate is None:
        return router_config(issued)
    _admit_certified(issued)
    hosts = [certified_client(name, robots_grant(*robots)) for name, robots in gate.robots.items()]
    config = router_config(issued, [gate.endpoint], hosts)
    tls = load_keys(gate.keys).listening | {"so_sndbuf": TlsLinkParameters.send_buffer}
    set_value(config, "transport/link/tls", tls)
    keep_alive = round(SessionParameters.lease_s / TlsLinkParameters.push_s)
    set_value(config, "transport/link/tx/keep_alive", keep_alive)
    return config


def host_config(issued: Credentials, keys: Keys, endpoint: str) -> zenoh.Config:
    """Return the configuration of a host: a router for its robots, connected to the world's `endpoint`."""
    config = router_config(issued, remote=[AdmittedClient("world", OVER_TLS, _WORLD)])
    set_value(config, "connect/endpoints", [endpoint])
    users = {"dictionary_file": str(issued.dictionary), "user": CERTIFIED, "password": CERTIFIED}
    set_value(config, "transport/auth/usrpwd", users)
    set_value(config, "transport/link/tls", keys.connecting | {"so_sndbuf": TlsLinkParameters.send_buffer})
    return config
