"""The viewer: rerun's own program, in a window, in a browser, or without either for pictures."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple
from urllib.parse import quote

from actors.runtime.errors import AcrcError
from actors.runtime.linux import PR_SET_PDEATHSIG, prctl

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

_THEME = "&theme=dark"
"""Robots' names have their colours, which on a light ground nobody can read."""
_PATIENCE = 15.0
"""How long the viewer may take to open its port, s."""


@dataclass(frozen=True)
class OpenViewer:
    """A viewer that takes what it is sent."""

    address: str
    """To send to."""
    page: str
    """Where a browser finds it; empty for a window."""
    process: "subprocess.Popen[bytes]"


def has_display(environment: Mapping[str, str], platform: str) -> bool:
    """True if a window can be opened; X11 and Wayland name their display in the environment."""
    if platform.startswith("linux"):
        return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
    return True


def open_window() -> OpenViewer:
    """Start the viewer in a window that stays when this program ends; RuntimeError if it does not come up."""
    return _start(["--hide-welcome-screen"], "")


def open_page() -> OpenViewer:
    """Serve the viewer to a browser on this machine until `process` is ended; RuntimeError if that fails."""
    port = _free_port()
    opened = _start(["--serve-web", "--web-viewer-port", str(port)], f"http://127.0.0.1:{port}/?url=")
    if not _listens(port, opened.process):  # the page comes up after the port for data
        opened.process.kill()
        raise RuntimeError(f"rerun's viewer did not serve its page within {_PATIENCE:g} s")
    return opened


def open_any(say: Callable[[str], None], instead: str) -> OpenViewer | None:
    """A window, or a page where there is no display; None where neither comes up, which is said.

    `instead`: what becomes of the view then.
    """
    try:
        return open_window() if has_display(os.environ, sys.platform) else open_page()
    except (OSError, RuntimeError) as error:
        say(f"The viewer does not open ({error}): {instead}.")
        return None


def open_headless(width: int, height: int) -> OpenViewer:
    """Start the viewer without a window until `process` is ended; RuntimeError if it does not come up."""
    size = f"{width}x{height}"
    return _start(["--headless", "--hide-welcome-screen", "--window-size", size], "")


def end(opened: OpenViewer | None) -> None:
    """End a viewer that is not a window: those stay."""
    if opened is not None and opened.page:
        opened.process.terminate()
        opened.process.wait()


def _start(words: Sequence[str], page: str) -> OpenViewer:
    """Start the program, listening on this machine only; all but a window end with this process."""
    port, tied = _free_port(), "--serve-web" in words or "--headless" in words
    viewer = subprocess.Popen(
        [_program(), "--port", str(port), "--bind", "127.0.0.1", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=_tie if tied and sys.platform == "linux" else None,  # noqa: PLW1509  # one call of prctl
        env={**os.environ, "RERUN_ANALYTICS": "0"},  # a run tells nobody that it takes place
    )
    if not _listens(port, viewer):
        if viewer.poll() is not None:
            raise RuntimeError(f"rerun's viewer ended at once with status {viewer.returncode}")
        viewer.kill()
        raise RuntimeError(f"rerun's viewer did not open its port within {_PATIENCE:g} s")
    address = f"rerun+http://127.0.0.1:{port}/proxy"
    found = f"{page}{quote(address, safe='')}{_THEME}" if page else ""
    return OpenViewer(address, found, viewer)


def _tie() -> None:
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


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


_SETTLING_S: Final = 0.7
"""What a moment needs is loaded once it is asked for, so a picture counts when the next one is the same."""
_MOST: Final = 12
"""Pictures; then the last one has to do."""
_TOASTS_S: Final = 4.0
"""So long the viewer covers its corner with what it has to say of the machine, s."""


class ScreenshotError(AcrcError):
    """A picture that could not be taken."""


class Reported(NamedTuple):
    """One view of the window."""

    name: str
    kind: str
    reports: tuple[str, ...]
    """What the viewer finds wrong with it."""


class Shot(NamedTuple):
    """A picture, and what was on it."""

    png: bytes
    views: tuple[Reported, ...]


def take(view: Path, second: float, width: int = 1600, height: int = 900) -> Shot:
    """The window as it opens a view file, at an instant, s, in points.

    Raises ScreenshotError where the viewer does not come up, such as for want of a Vulkan driver; on Debian
    `apt-get install mesa-vulkan-drivers` brings one that needs no graphics card.
    """
    # Runs without the package rerun import this module for its sentences.
    from rerun.experimental import ViewerClient  # noqa: PLC0415

    from actors.observer.canvas import TIMELINE  # noqa: PLC0415

    try:
        opened = open_headless(width, height)
    except (OSError, RuntimeError) as error:
        raise ScreenshotError(
            f"{error}; without a graphics card it needs the Debian package mesa-vulkan-drivers"
        ) from None
    try:
        began = time.monotonic()
        client = ViewerClient.connect(opened.address)
        client.open(str(view))
        client.set_time(TIMELINE, duration=second, play_state="paused")
        png = _settled(client, began + _TOASTS_S)
        views = tuple(
            Reported(one.name or "", one.view_class, tuple(str(said) for said in one.reports))
            for one in client.get_state().views
        )
        return Shot(png, views)
    except (RuntimeError, TimeoutError, ConnectionError) as error:
        raise ScreenshotError(f"{view}: the viewer took no picture: {error}") from None
    finally:
        opened.process.kill()
        opened.process.wait()


def _settled(client: "ViewerClient", earliest: float) -> bytes:
    """The first picture that is like the one before it."""
    last = b""
    for _ in range(_MOST):
        try:
            png: bytes = client.take_screenshot()
        except TimeoutError:
            continue
        if png == last and time.monotonic() >= earliest:
            break
        last = png
        time.sleep(_SETTLING_S)
    if not last:
        raise TimeoutError("it was asked in vain")
    return last
