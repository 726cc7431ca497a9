"""Headless Chromium, driven by the DevTools protocol."""

import json
import shutil
import subprocess
import time
from base64 import b64decode
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self
from urllib.request import urlopen

from websockets.sync.client import connect

CHROMIUM: Final = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
_WORDS: Final = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--remote-debugging-port=0",
    "--window-size=1200,800",
)  # fmt: skip
_WHOLE: Final = "document.readyState == 'complete' && [...document.images].every(one => one.complete)"

_KEYS: Final[dict[str, dict[str, Any]]] = {
    **{
        f"Arrow{name}": {"code": f"Arrow{name}", "windowsVirtualKeyCode": 37 + number}
        for number, name in enumerate(("Left", "Up", "Right", "Down"))
    },
    "Enter": {"code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"},
    "Escape": {"code": "Escape", "windowsVirtualKeyCode": 27},
    "Tab": {"code": "Tab", "windowsVirtualKeyCode": 9},
}


class PageLeftError(AssertionError):
    """The browser has left the page during a command."""


class Browser:
    """Context manager for a browser with one page."""

    def __init__(self, home: Path, url: str) -> None:
        assert CHROMIUM is not None
        self._process = subprocess.Popen(
            [CHROMIUM, *_WORDS, f"--user-data-dir={home}", url],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._number = 0
        try:
            port = until(lambda: _port(home / "DevToolsActivePort"))
            page = until(lambda: _page(port))
            self._stack = ExitStack()
            self._socket = self._stack.enter_context(connect(page, max_size=1 << 26))
        except BaseException:
            self._process.kill()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()
        self._process.terminate()
        self._process.wait(20)

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Send a protocol command; return its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(20))
            if told.get("id") == self._number:
                if "navigated" in told.get("error", {}).get("message", ""):
                    raise PageLeftError(told)
                assert "error" not in told, told
                result: dict[str, Any] = told["result"]
                return result

    def value(self, expression: str) -> Any:
        """Evaluate an expression on the page, and await promises; None if it raises."""
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return told["result"].get("value")

    def open(self, url: str, *, width: int = 1200, height: int = 800, scheme: str = "light") -> None:
        """Open a page with this size, px, and colour scheme; wait until it is complete."""
        self.scheme(scheme)
        self.size(width, height)
        self.call("Page.navigate", url=url)
        until(lambda: self.value(f"location.href.startsWith({json.dumps(url)}) && {_WHOLE}"))

    def until(self, expression: str) -> None:
        """Wait until an expression is true, on this page or the one it navigates to."""

        def come() -> Any:
            with suppress(PageLeftError):
                return self.value(expression)
            return None

        until(come)

    def shot(self) -> bytes:
        """Return a screenshot as PNG."""
        return b64decode(self.call("Page.captureScreenshot")["data"])

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag the mouse from one point to another."""
        middle = ((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2)
        for kind, (x, y) in (
            ("mouseMoved", begin), ("mousePressed", begin), ("mouseMoved", middle), ("mouseMoved", end),
            ("mouseReleased", end),
        ):  # fmt: skip
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def press(self, key: str, *, shift: bool = False) -> None:
        """Press and release a key, named as in `KeyboardEvent.key`."""
        told: dict[str, Any] = {"key": key, "modifiers": 8 * shift, **_KEYS.get(key, {})}
        if len(key) == 1:
            told |= {"text": key, "windowsVirtualKeyCode": ord(key.upper())}
        self.call("Input.dispatchKeyEvent", type="keyDown", **told)
        self.call("Input.dispatchKeyEvent", type="keyUp", **told)

    def touch(self, *stations: list[tuple[float, float]]) -> None:
        """Touch the points of the first station, move to the others, release."""
        for number, points in enumerate(stations):
            told = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(points)]
            self.call(
                "Input.dispatchTouchEvent", type="touchMove" if number else "touchStart", touchPoints=told
            )
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def size(self, width: int, height: int, *, mobile: bool = False) -> None:
        """Set the window size, px."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=mobile,
        )  # fmt: skip
        self.call("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def scheme(self, name: str) -> None:
        """Set the preferred colour scheme, `light` or `dark`."""
        told = [{"name": "prefers-color-scheme", "value": name}]
        self.call("Emulation.setEmulatedMedia", features=told)

    def picture(self, file: Path) -> None:
        """Write a screenshot to a PNG file."""
        file.write_bytes(self.shot())

    def click(self, selector: str) -> None:
        """Click in the middle of an element."""
        box = self.value(
            f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect(); "
            "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        self.drag(box, box)


def until(come: Callable[[], Any], patience_s: float = 30.0) -> Any:
    """Wait until `come` returns a true value; return it."""
    deadline = time.monotonic() + patience_s
    while not (found := come()):
        assert time.monotonic() < deadline, "timeout"
        time.sleep(0.02)
    return found


def _port(file: Path) -> str | None:
    lines = file.read_text().splitlines() if file.exists() else []
    return lines[0] if lines else None


def _page(port: str) -> str | None:
    try:
        with urlopen(f"http://127.0.0.1:{port}/json", timeout=5) as answer:
            targets = json.loads(answer.read())
    except OSError:
        return None
    return next((one["webSocketDebuggerUrl"] for one in targets if one["type"] == "page"), None)
