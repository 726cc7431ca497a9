"""Pictures of a view, taken by the real viewer without a window."""

import time
from pathlib import Path
from typing import Final, NamedTuple

from rerun.experimental import ViewerClient

from actors.observer import viewer
from actors.observer.drawing.canvas import TIMELINE
from actors.runtime.errors import AcrcError

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
    try:
        opened = viewer.open_headless(width, height)
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


def _settled(client: ViewerClient, earliest: float) -> bytes:
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
