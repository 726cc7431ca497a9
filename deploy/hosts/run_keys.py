"""The keys of one run over several computers: an authority that nobody keeps, and what it has signed.

The private keys of hosts travel to them through the cluster; the authority's own is never written.
"""

import os
import socket
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from actors.runtime.access.credentials import PRIVATE_KEY_FILE
from actors.runtime.access.tls import AUTHORITY_FILE, CERTIFICATE_FILE
from deploy.hosts import certificates
from deploy.hosts.certificates import CLIENT, SERVER, Pair

_DAYS: Final = 30
"""Longer than any run; whoever finds the keys of an ended run finds nobody who would take them."""


@dataclass(frozen=True)
class PemKeys:
    """With what one computer of the run proves who it is, in PEM."""

    authority: bytes
    certificate: bytes
    private_key: bytes

    def write(self, folder: Path) -> None:
        """Into a folder for its owner's eyes; it may be there already."""
        folder.mkdir(mode=0o700, exist_ok=True)
        (folder / AUTHORITY_FILE).write_bytes(self.authority)
        (folder / CERTIFICATE_FILE).write_bytes(self.certificate)
        handle = os.open(folder / PRIVATE_KEY_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(self.private_key)


@dataclass(frozen=True)
class RunKeys:
    """Everybody's keys for one run."""

    world: PemKeys
    """Of the computer on which the run was started."""
    hosts: dict[str, PemKeys]
    issuer: Pair
    """The authority: whoever drew the keys may sign more, and forgets it then."""


def draw(hosts: Sequence[str], address: str) -> RunKeys:
    """New keys. `hosts`: their common names. `address`: where the first computer is connected to."""
    now = datetime.now(UTC)
    issuer = certificates.authority("run", now, _DAYS)
    world = certificates.machine(issuer, "world", [SERVER], [address], now, _DAYS)
    made = {name: certificates.machine(issuer, name, [CLIENT], [], now, _DAYS) for name in hosts}
    return RunKeys(_keys(issuer, world), {name: _keys(issuer, pair) for name, pair in made.items()}, issuer)


def server_context(folder: Path) -> ssl.SSLContext:
    """For whoever waits for hosts, with the keys in the folder."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    _load(context, folder)
    return context


def connect(folder: Path, address: str, port: int, patience_s: float) -> ssl.SSLSocket:
    """Connect a host, with the keys in the folder. Raises OSError."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    _load(context, folder)
    plain = socket.create_connection((address, port), timeout=patience_s)
    return context.wrap_socket(plain, server_hostname=address)


def common_name(encrypted: ssl.SSLSocket) -> str:
    """Of the certificate that the other end has shown; empty if there is none."""
    shown = encrypted.getpeercert() or {}
    subject: tuple[tuple[tuple[str, str], ...], ...] = shown.get("subject", ())  # type: ignore[assignment]
    return next((value for part in subject for key, value in part if key == "commonName"), "")


def _load(context: ssl.SSLContext, folder: Path) -> None:
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_verify_locations(folder / AUTHORITY_FILE)
    context.load_cert_chain(folder / CERTIFICATE_FILE, folder / PRIVATE_KEY_FILE)


def _keys(issuer: Pair, pair: Pair) -> PemKeys:
    return PemKeys(issuer.certificate_pem, pair.certificate_pem, pair.private_pem)
