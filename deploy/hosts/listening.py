"""Addresses and ports of this computer at which hosts of a run connect."""

import errno
import re
import socket
from typing import Final

from actors.installation.usage import wrong_value
from actors.runtime.errors import AcrcError
from deploy.clusters.address import host_and_port

_PLACE: Final = re.compile(r"(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\])(?::(?P<port>[0-9]{1,5}))?")


def place_of(word: str) -> tuple[str, int]:
    """What `--listen HOST` or `--listen HOST:PORT` says; port 0: any two. Raises OptionError."""
    found = _PLACE.fullmatch(word)
    port = int(found["port"] or 0) if found else -1
    if found is None or not 0 <= port < 65535:
        expected = (
            "an address of this computer, with the first of two ports or without, such as 10.0.0.5:7450"
        )
        raise wrong_value("--listen", word, expected)
    return found["host"].strip("[]"), port


def own_address(address: str) -> str:
    """Under which the scheduler's computer, and so its workers, see this one."""
    place = host_and_port(address)
    family, kind, proto, _, where = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, kind, proto) as probe:
        probe.connect(where)  # of a datagram socket: nothing is sent
        return str(probe.getsockname()[0])


def bound(address: str) -> str:
    """Where to listen for those who connect to `address`: there, or everywhere if this computer is reached
    by another's address. Raises AcrcError."""
    try:
        with socket.create_server((address, 0), family=_family(address)):
            return address
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            return "::" if ":" in address else "0.0.0.0"
        raise AcrcError(
            f"--listen: {address}: {error.strerror}; must be an address of this computer"
        ) from None


def listening(address: str, port: int) -> socket.socket:
    """A socket that listens there, at any port if that is 0. Raises AcrcError."""
    try:
        return socket.create_server((address, port), family=_family(address))
    except OSError as error:
        raise AcrcError(
            f"--listen: cannot listen at {bracketed(address)}:{port}: {error.strerror}; must be two ports "
            "that nobody has, such as 7450 and the next"
        ) from None


def free_port(address: str) -> int:
    """A port there that nobody has now. Raises AcrcError."""
    with listening(address, 0) as probe:
        return int(probe.getsockname()[1])


def bracketed(address: str) -> str:
    """The address as it stands before a port."""
    return f"[{address}]" if ":" in address else address


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address else socket.AF_INET
