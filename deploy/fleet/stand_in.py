"""Says stop in place of a base process that is stopped, for its guardian may be stopped with it."""

import os
from collections.abc import Callable
from typing import Final

from actors.runtime.lifecycle.process_table import glance
from firmware_bridge.kobuki import guardian

LOOK_S: Final = 0.05
"""The base process is looked at so often, and stop said, s; own choice."""


class StandIn:
    """Has the base's port while the base process is stopped."""

    def __init__(self, port: str, say: Callable[[str], None]) -> None:
        """`port`: of the base; `say` is told what is done."""
        self._path = port
        self._say = say
        self._port: int | None = None

    def look(self, base: int | None) -> None:
        """Say stop if that process is stopped, if there is one; never waits."""
        found = None if base is None else glance(base)
        if found is None or not found.stopped:
            self._close()
            return
        if self._port is None:
            try:
                self._port = guardian.open_alone(self._path)
            except OSError:
                return  # unplugged: nobody can say it
            self._say("base is stopped (SIGSTOP or a debugger): stop is said in its place")
        if not guardian.say_stop(self._port, guardian.Standstill()):
            self._close()

    def _close(self) -> None:
        if self._port is not None:
            os.close(self._port)
            self._port = None
