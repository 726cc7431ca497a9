"""The viewer program of rerun: in a window, in a browser, or headless for screenshots."""

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
"""Robots' names have their colours, which are illegible on a light background."""
_PATIENCE = 15.0
"""Timeout for the viewer to open its port, s."""


@dataclass(frozen=True)
class OpenViewer:
    """A running viewer."""

    address: str
    """Address for data."""
    page: str
    """URL for a browser; empty for a window."""
    process: "subprocess.Popen[bytes]"


def has_display(environment: Mapping[str, str], platform: str) -> bool:
    """Return True if a window can be opened, by the variables of X11 and Wayland."""
    if platform.startswith("linux"):
        return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
    return True


def open_window() -> OpenViewer:
    """Open a window that stays open when this program exits. Raises RuntimeError if that fails."""
    return _start(["--hide-welcome-screen"], "")


def open_page() -> OpenViewer:
    """Serve the viewer to a local browser until `process` ends. Raises RuntimeError if that fails."""
    port = _free_port()
    opened = _start(["--serve-web", "--web-viewer-port", str(port)], f"http://127.0.0.1:{port}/?url=")
    if not _is_listening(port, opened.process):  # the page's port opens after the data port
        opened.process.kill()
        raise RuntimeError(f"rerun's viewer did not serve its page within {_PATIENCE:g} s")
    return opened


def open_any(report: Callable[[str], None], fallback: str) -> OpenViewer | None:
    """Open a window, or a page without a display; report and return None if that fails.

    `fallback`: sentence for the report about what is done instead.
    """
    try:
        return open_window() if has_display(os.environ, sys.platform) else open_page()
    except (OSError, RuntimeError) as error:
        report(f"Cannot open the viewer ({error}); {fallback}.")
        return None


def open_headless(width: int, height: int) -> OpenViewer:
    """Start the viewer without a window until `process` ends. Raises RuntimeError if that fails."""
    size = f"{width}x{height}"
    return _start(["--headless", "--hide-welcome-screen", "--window-size", size], "")


def terminate(opened: OpenViewer | None) -> None:
    """Terminate a served viewer; windows stay open."""
    if opened is not None and opened.page:
        opened.process.terminate()
        opened.process.wait()


def _start(arguments: Sequence[str], page: str) -> OpenViewer:
    """Start the program, listening locally; unless it is a window, it exits with this process."""
    port, tied = _free_port(), "--serve-web" in arguments or "--headless" in arguments
    viewer = subprocess.Popen(
        [_program(), "--port", str(port), "--bind", "127.0.0.1", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=_tie if tied and sys.platform == "linux" else None,  # noqa: PLW1509  # one call of prctl
        env={**os.environ, "RERUN_ANALYTICS": "0"},  # no analytics
    )
    if not _is_listening(port, viewer):
        if viewer.poll() is not None:
            raise RuntimeError(f"rerun's viewer exited at once with code {viewer.returncode}")
        viewer.kill()
        raise RuntimeError(f"rerun's viewer did not open its port within {_PATIENCE:g} s")
    address = f"rerun+http://127.0.0.1:{port}/proxy"
    found = f"{page}{quote(address, safe='')}{_THEME}" if page else ""
    return OpenViewer(address, found, viewer)


def _tie() -> None:
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _program() -> Path:
    """Return the path of the viewer's binary; the script of the same name would start it as a child."""
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise RuntimeError("rerun's viewer is not installed")
    return Path(package.origin).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _is_listening(port: int, viewer: "subprocess.Popen[bytes]") -> bool:
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline and viewer.poll() is None:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0):
                return True
        except OSError:
            time.sleep(0.05)
    return False


_SETTLING_S: Final = 0.7
"""Interval between screenshots, s; data is loaded on demand, so two equal ones in a row are final."""
_MAX_TRIES: Final = 12
"""Maximum number of screenshots; the last one is used."""
_TOASTS_S: Final = 4.0
"""How long notifications cover a corner of the viewer, s."""


class ScreenshotError(AcrcError):
    """A failed screenshot."""


class ViewReport(NamedTuple):
    """One view in the window."""

    name: str
    kind: str
    reports: tuple[str, ...]
    """Errors and warnings of the viewer."""


class Screenshot(NamedTuple):
    """A screenshot and its views."""

    png: bytes
    views: tuple[ViewReport, ...]


def take_screenshot(view: Path, second: float, width: int = 1600, height: int = 900) -> Screenshot:
    """Take a screenshot of a view file at an instant, s; width and height in points.

    Raises ScreenshotError if the viewer does not start, for example without a Vulkan driver; on Debian,
    `apt-get install mesa-vulkan-drivers` installs one for machines without a graphics card.
    """
    # Imported here, as runs without the package rerun import this module, too.
    from rerun.experimental import ViewerClient  # noqa: PLC0415

    from actors.observer.canvas import TIMELINE  # noqa: PLC0415

    try:
        opened = open_headless(width, height)
    except (OSError, RuntimeError) as error:
        raise ScreenshotError(
            f"{error}; without a graphics card, install the Debian package mesa-vulkan-drivers"
        ) from None
    try:
        began = time.monotonic()
        client = ViewerClient.connect(opened.address)
        client.open(str(view))
        client.set_time(TIMELINE, duration=second, play_state="paused")
        png = _stable_screenshot(client, began + _TOASTS_S)
        views = tuple(
            ViewReport(one.name or "", one.view_class, tuple(str(said) for said in one.reports))
            for one in client.get_state().views
        )
        return Screenshot(png, views)
    except (RuntimeError, TimeoutError, ConnectionError) as error:
        raise ScreenshotError(f"{view}: no screenshot: {error}") from None
    finally:
        opened.process.kill()
        opened.process.wait()


def _stable_screenshot(client: "ViewerClient", earliest: float) -> bytes:
    """Return the first screenshot that equals the previous one."""
    last = b""
    for _ in range(_MAX_TRIES):
        try:
            png = client.take_screenshot()
        except TimeoutError:
            continue
        if png == last and time.monotonic() >= earliest:
            break
        last = png
        time.sleep(_SETTLING_S)
    if not last:
        raise TimeoutError("the viewer did not answer")
    return last
