"""The certificate for a cluster, from Dask's own configuration, and what is wrong with it."""

import socket
import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from distributed import Security

from deploy.clusters.address import PAGE, ClusterError, host_and_port

_KEYS: Final = {"ca_file": "ca-file", "cert": "client.cert", "key": "client.key"}
"""What has to be configured, by Dask's name for it below distributed.comm.tls."""


def security(address: str, patience_s: float, named: str = "--on") -> Security:
    """What a client presents at a tls:// address, tried once, so that a refusal has its reason.

    `named`: the option or argument that gave the address. Raises ClusterError where something is not
    configured, or one of the two does not take the other's certificate.
    """
    given = Security(require_encryption=True)
    files = given.get_tls_config_for_role("client")
    context = _context(given, files, address, named)
    try:
        with (
            socket.create_connection(host_and_port(address), timeout=patience_s) as plain,
            context.wrap_socket(plain) as encrypted,
        ):
            encrypted.recv(1)  # a scheduler speaks first; one that refuses says why
    except ssl.SSLCertVerificationError as error:
        raise ClusterError(
            f"{named} {address}: the scheduler's certificate is not accepted: {error.verify_message}; must "
            f"be signed by the ca-file {files['ca_file']}, and valid now ({PAGE})"
        ) from None
    except ssl.SSLError as error:
        raise ClusterError(
            f"{named} {address}: the scheduler does not accept the certificate {files['cert']}, or has "
            f"no TLS: {(error.reason or 'connection closed').lower().replace('_', ' ')} ({PAGE})"
        ) from None
    except OSError as error:
        raise ClusterError(
            f"{named} {address}: no Dask scheduler answers there: {error.strerror or error}"
        ) from None
    return given


def _context(given: Security, files: Mapping[str, str | None], address: str, named: str) -> ssl.SSLContext:
    for name, key in _KEYS.items():
        path = files[name]
        where = f"distributed.comm.tls.{key} in Dask's configuration"
        if not path:
            raise ClusterError(f"{named} {address}: there is no {where}; must name a file in PEM ({PAGE})")
        if not Path(path).is_file():
            raise ClusterError(f"{named} {address}: {where} is {path}; must be a file in PEM ({PAGE})")
    try:
        context: ssl.SSLContext = given.get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{named} {address}: {', '.join(str(path) for path in files.values() if path)}: cannot be used "
            f"as authority, certificate and its key: {error}"
        ) from None
    return context
