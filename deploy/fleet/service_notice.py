"""Tells systemd that a service is up, and that it lives: sd_notify(3), without its library."""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

_SOCKET: Final = "NOTIFY_SOCKET"


class ServiceNotice:
    """The way to systemd, where it has started this process; elsewhere all of it does nothing."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """`environment`: of this process, if not given; systemd says there where it listens."""
        address = (os.environ if environment is None else environment).get(_SOCKET, "")
        self._socket: socket.socket | None = None
        if address[:1] in {"/", "@"}:
            self._address = address.replace("@", "\0", 1) if address[0] == "@" else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ready(self) -> None:
        """All processes have been started."""
        self._say("READY=1")

    def lives(self) -> None:
        """To be called all the time: without it systemd ends the service after a while."""
        self._say("WATCHDOG=1")

    def _say(self, line: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # systemd is busy: the next one will do
                self._socket.sendto(line.encode(), self._address)
