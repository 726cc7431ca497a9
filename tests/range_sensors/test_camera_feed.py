"""A camera in a thread: nobody waits for it, and no error of its own gets out."""

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from firmware_bridge.range_sensors.depth_camera import Camera, CameraError, CameraFeed

IMAGE: NDArray[np.uint16] = np.full((2, 2), 7, np.uint16)


class Scripted:
    """Gives an image at once for each True in its script, fails for a sentence, and then hangs."""

    def __init__(self, script: list[bool | str], hang: threading.Event) -> None:
        self._script = script
        self._hang = hang
        self.closed = False

    def read(self, patience: float) -> NDArray[np.uint16] | None:
        if not self._script:
            self._hang.wait(10)
            return None
        said = self._script.pop(0)
        if isinstance(said, str):
            raise CameraError(said)
        return IMAGE if said else None

    def close(self) -> None:
        self.closed = True


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline, "it has not come to that"
        time.sleep(0.005)


def test_images_come_a_camera_that_fails_is_opened_again_and_one_that_hangs_holds_up_nobody() -> None:
    hang = threading.Event()
    cameras = [Scripted([True, "it gives no image"], hang), Scripted([True, True], hang)]
    opened: list[Camera] = []
    said: list[str] = []

    def open_camera() -> Camera:
        if len(opened) == 1 and not said[1:]:
            raise OSError("no such device")
        opened.append(cameras[len(opened)])
        return opened[-1]

    feed = CameraFeed(open_camera, lambda: Instant(5), said.append)
    until(lambda: len(opened) == 2)
    assert said == ["it gives no image", "no such device"]
    assert cameras[0].closed and feed.errors == 2
    until(lambda: feed.missed == 2)
    image = feed.take()
    assert image is not None and image.stamp == 5 and image.depth is IMAGE
    assert feed.take() is None
    begun = time.monotonic()
    feed.close()
    assert time.monotonic() - begun < 1.0, "it hangs, and is left alone"
    hang.set()
