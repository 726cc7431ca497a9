"""Why a robot is not reached: Zenoh does not say it, so a handshake of our own shows how far it comes."""

import socket
import ssl

from actors.runtime.access.tls import Keys

_REFUSAL_S = 0.3
"""How long a robot may take to refuse the laptop's certificate, which TLS 1.3 tells after the handshake."""


def cause(endpoint: str, keys: Keys, patience_s: float) -> str:
    """What keeps this laptop from a session with `tls/HOST:PORT`; empty if a handshake succeeds."""
    host, _, port = endpoint.removeprefix("tls/").rpartition(":")
    host = host.strip("[]")
    try:
        context = ssl.create_default_context(cafile=str(keys.authority))
        context.load_cert_chain(keys.certificate, keys.private_key)
        with (
            socket.create_connection((host, int(port)), patience_s) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
        ):
            secure.settimeout(_REFUSAL_S)
            return _refusal(secure)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not accepted here, {error.verify_message.rstrip('.')}"
    except ssl.SSLError as error:
        return f"no secure connection, {(error.reason or str(error)).replace('_', ' ').lower()}"
    except TimeoutError:
        return f"no answer within {patience_s:g} s"
    except OSError as error:
        return (error.strerror or str(error)).lower()


def _refusal(secure: ssl.SSLSocket) -> str:
    try:
        return "" if secure.recv(1) else "it closed the connection"
    except TimeoutError:
        return ""  # a router waits for the first word
    except ssl.SSLError as error:
        return (
            f"it does not accept this laptop's certificate, {(error.reason or '').replace('_', ' ').lower()}"
        )
