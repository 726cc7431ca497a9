"""Addresses of schedulers and of this computer; does not import the cluster packages."""

import errno
import ipaddress
import re
import socket
from typing import Final

from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError

_ADDRESS: Final = re.compile(
    r"(?P<how>tls|tcp|dask\+tls|dask)://(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\]):(?P<port>[0-9]{1,5})"
)
PAGE: Final = "docs/clusters.md"


def check_address(address: str, option: str = "--on") -> None:
    """Raise OptionError for an invalid scheduler address, or a remote one without TLS.

    `option`: option or argument with the address.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match["port"]) < 65536:
        raise wrong_value(option, address, "the address of a scheduler, such as tls://192.168.1.5:8786")
    if not is_safe(address):
        raise OptionError(
            f"{option}: {address}; must be tls://, except on this computer: without TLS anyone who can "
            f"connect can execute code ({PAGE})"
        )


def dask_address(address: str, option: str = "--on") -> str:
    """Return an address in Dask's form: tls:// for dask+tls://, tcp:// for dask://.

    Raises OptionError, see `check_address`.
    """
    check_address(address, option)
    scheme, _, location = address.partition("://")
    return f"{'tls' if scheme.endswith('tls') else 'tcp'}://{location}"


def host_and_port(address: str) -> tuple[str, int]:
    """Return host and port of a valid address, or endpoint such as tls/HOST:PORT."""
    host, _, port = address.rpartition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def is_safe(address: str) -> bool:
    """Return whether an address has TLS, or is only reachable from this computer."""
    scheme, _, location = address.partition("://")
    host = location.rpartition(":")[0].strip("[]")
    if scheme in {"tls", "dask+tls", "inproc"} or host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


_HOST_PORT: Final = re.compile(r"(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\])(?::(?P<port>[0-9]{1,5}))?")


def parse_listen(word: str) -> tuple[str, int]:
    """Parse `--listen HOST` or `--listen HOST:PORT`; port 0: any. Raises OptionError."""
    match = _HOST_PORT.fullmatch(word)
    port = int(match["port"] or 0) if match else -1
    if match is None or not 0 <= port < 65536:
        raise wrong_value("--listen", word, "an address of this computer, such as 10.0.0.5 or 10.0.0.5:7450")
    return match["host"].strip("[]"), port


def local_address(address: str) -> str:
    """Return the address of this computer on its route to the scheduler at `address`."""
    location = host_and_port(address)
    family, kind, proto, _, peer_address = socket.getaddrinfo(*location, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, kind, proto) as probe:
        probe.connect(peer_address)  # sends nothing: a datagram socket
        return str(probe.getsockname()[0])


def bind_address(address: str) -> str:
    """Return the address to bind for clients that connect to `address`. Raises AcrcError.

    If this computer does not have `address` (as behind NAT), bind all addresses.
    """
    try:
        with socket.create_server((address, 0), family=_family(address)):
            return address
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            return "::" if ":" in address else "0.0.0.0"
        raise AcrcError(
            f"--listen: {address}: {error.strerror}; must be an address of this computer"
        ) from None


def free_port(address: str, port: int = 0) -> int:
    """Return the port if it is free; 0: any free port. Raises AcrcError."""
    try:
        with socket.create_server((address, port), family=_family(address)) as probe:
            return int(probe.getsockname()[1])
    except OSError as error:
        raise AcrcError(
            f"--listen: cannot listen at {bracketed(address)}:{port}: {error.strerror}; must be a free port"
        ) from None


def bracketed(address: str) -> str:
    """Return the address as in a URL: IPv6 in brackets."""
    return f"[{address}]" if ":" in address else address


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address else socket.AF_INET
