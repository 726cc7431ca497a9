"""The window: rerun's own viewer program, started beside the run if the machine has a display."""

import importlib.util
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

_PATIENCE = 15.0
"""How long the viewer may take to open its port, s."""


def has_display(environment: Mapping[str, str], platform: str) -> bool:
    """True if a window can be opened; X11 and Wayland name their display in the environment."""
    if platform.startswith("linux"):
        return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
    return True


def spawn() -> str:
    """Start the viewer and give the address to send to; RuntimeError if it does not come up.

    It listens on this machine only and stays open after the run.
    """
    port = _free_port()
    viewer = subprocess.Popen(
        [_program(), "--port", str(port), "--bind", "127.0.0.1", "--hide-welcome-screen"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "RERUN_ANALYTICS": "0"},  # a run tells nobody that it takes place
    )
    if not _listens(port, viewer):
        if viewer.poll() is not None:
            raise RuntimeError(f"rerun's viewer ended at once with status {viewer.returncode}")
        viewer.kill()
        raise RuntimeError(f"rerun's viewer did not open its port within {_PATIENCE:g} s")
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _program() -> Path:
    """The viewer's program itself; the script of the same name would only start it as its child."""
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise RuntimeError("rerun's viewer is not installed")
    return Path(package.origin).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _listens(port: int, viewer: "subprocess.Popen[bytes]") -> bool:
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline and viewer.poll() is None:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0):
                return True
        except OSError:
            time.sleep(0.05)
    return False
