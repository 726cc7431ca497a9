"""With what a computer of a run proves to another one who it is: keys in files, and connections by them."""

import os
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from actors.runtime.access.credentials import PRIVATE_KEY_FILE
from actors.runtime.access.tls import AUTHORITY_FILE, CERTIFICATE_FILE


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


def server_context(folder: Path) -> ssl.SSLContext:
    """For whoever waits for hosts, with the keys in the folder."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    _load(context, folder)
    return context


def client_context(folder: Path) -> ssl.SSLContext:
    """For a host, with the keys in the folder."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    _load(context, folder)
    return context


def connect(folder: Path, address: str, port: int, patience_s: float) -> ssl.SSLSocket:
    """Connect a host, with the keys in the folder. Raises OSError."""
    plain = socket.create_connection((address, port), timeout=patience_s)
    return client_context(folder).wrap_socket(plain, server_hostname=address)


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
