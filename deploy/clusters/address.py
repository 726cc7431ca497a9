"""Addresses of schedulers; needs no packages of the cluster."""

import ipaddress
import re
from typing import Final

from actors.installation.usage import OptionError, wrong_value

_ADDRESS: Final = re.compile(
    r"(?P<how>tls|tcp|dask\+tls|dask)://(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\]):(?P<port>[0-9]{1,5})"
)
PAGE: Final = "docs/clusters.md"


def check(address: str, named: str = "--on") -> None:
    """Raise OptionError for what is no scheduler's address, or one that anybody could give work to.

    `named`: the option or argument that it was.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or not 0 < int(found["port"]) < 65536:
        raise wrong_value(named, address, "the address of a scheduler, such as tls://192.168.1.5:8786")
    if not is_safe(address):
        raise OptionError(
            f"{named}: {address}; must be tls:// anywhere but on this computer, for without TLS a cluster "
            f"runs whatever comes from whoever reaches it ({PAGE})"
        )


def plain(address: str, named: str = "--on") -> str:
    """A person's address as Dask spells it: dask+tls:// is tls://, and dask:// is tcp://.

    Raises OptionError, see `check`.
    """
    check(address, named)
    how, _, place = address.partition("://")
    return f"{'tls' if how.endswith('tls') else 'tcp'}://{place}"


def host_and_port(address: str) -> tuple[str, int]:
    """Both of an address that `check` lets pass."""
    host, _, port = address.partition("://")[2].rpartition(":")
    return host.strip("[]"), int(port)


def is_safe(address: str) -> bool:
    """True if it has TLS, or can be reached from this computer only."""
    how, _, place = address.partition("://")
    host = place.rpartition(":")[0].strip("[]")
    if how in {"tls", "dask+tls", "inproc"} or host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
