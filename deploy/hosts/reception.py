"""Where hosts of a run report: a port at which those with a certificate of the run are let in, each once."""

import select
import ssl
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from deploy.hosts import run_tls
from deploy.hosts.channel import to_host
from deploy.hosts.host_link import HostLink
from deploy.hosts.listening import listening

_HANDSHAKE_S: Final = 3.0
"""Somebody who comes and says nothing keeps those out so long who come behind."""


class HostReception:
    """Listens until it is closed."""

    def __init__(self, address: str, port: int, keys: Path) -> None:
        """`port`: 0: any. `keys`: folder with this computer's. Raises AcrcError."""
        self._context = run_tls.server_context(keys)
        self._server = listening(address, port)

    @property
    def port(self) -> int:
        """At which it listens."""
        return int(self._server.getsockname()[1])

    def admit(self, links: Sequence[HostLink], timeout_s: float) -> None:
        """Wait so long for somebody, and connect the link whose host it is, if it is any that is missing."""
        if not select.select([self._server], [], [], timeout_s)[0]:
            return
        plain, _ = self._server.accept()
        plain.settimeout(_HANDSHAKE_S)
        try:
            encrypted: ssl.SSLSocket = self._context.wrap_socket(plain, server_side=True)
        except (OSError, ValueError):
            plain.close()
            return
        name = run_tls.common_name(encrypted)
        link = next((link for link in links if link.name == name and not link.connected), None)
        if link is None:
            encrypted.close()
        else:
            link.connect(to_host(encrypted))

    def close(self) -> None:
        """Let nobody in any more."""
        self._server.close()
