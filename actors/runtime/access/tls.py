"""Mutual TLS between a robot's router and the operator's laptop: who may connect, and what it may do then.

Both show a certificate of the fleet's own authority, and the laptop's rights follow the common name in its
certificate. Actors on the robot itself go on using Unix sockets and passwords.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zenoh

from actors.runtime.access.credentials import PRIVATE_KEY_FILE, Credentials
from actors.runtime.access.rules import CERTIFIED, access_rules, other_grant, router_config
from actors.runtime.access.session_config import SessionParameters, session_config, set_value
from actors.runtime.errors import AcrcError

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
