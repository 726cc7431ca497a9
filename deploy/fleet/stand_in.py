"""Says stop in place of a base process that is stopped, for its guardian may be stopped with it."""

import subprocess
import sys
from collections.abc import Callable
from typing import Final

from actors.runtime.lifecycle.process_table import glance
from firmware_bridge.kobuki import guardian

LOOK_S: Final = 0.05
"""The base process is looked at so often, s; own choice: a small process takes as long to start."""


class StandIn:
    """Starts a guardian (firmware_bridge.kobuki.guardian) of its own whenever the base is found stopped."""

    def __init__(self, port: str, say: Callable[[str], None]) -> None:
        """`port`: of the base; `say` is told what is done."""
        self._port = port
        self._say = say
        self._guardian: subprocess.Popen[bytes] | None = None

    def look(self, base: int | None) -> None:
        """See whether that process is stopped, if there is one; never waits."""
        found = None if base is None else glance(base)
        if found is None or not found.stopped:
            if self._guardian is not None and self._guardian.poll() is not None:
                self._guardian = None
            return
        if self._guardian is None:
            self._guardian = subprocess.Popen(
                [sys.executable, "-I", "-S", guardian.__file__, "alone", self._port],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                cwd="/",
            )
            self._say("base is stopped (SIGSTOP or a debugger): stop is said in its place")
