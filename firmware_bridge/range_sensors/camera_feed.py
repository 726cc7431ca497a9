"""A depth camera in a thread of its own: what its library does, or does not, holds nobody up."""

import threading
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant

_PATIENCE_S: Final = 0.1
"""For one image; at 30 a second that is three."""
_RETRY_S: Final = 1.0
"""A camera that failed is tried again so often."""


class Camera(Protocol):
    """Gives depth images."""

    def read(self, patience: float) -> NDArray[np.uint16] | None:
        """The next image, mm; None if there is none after `patience` s."""

    def close(self) -> None:
        """Give the camera back."""


class Image(NamedTuple):
    """A depth image and when it came."""

    stamp: Instant
    depth: NDArray[np.uint16]


class CameraFeed:
    """The newest image of a camera that is opened, and after any error opened again."""

    def __init__(
        self, open_camera: Callable[[], Camera], clock: Callable[[], Instant], say: Callable[[str], None]
    ) -> None:
        """`say` is told what is wrong, each thing once until the camera works again; by this thread."""
        self._open = open_camera
        self._clock = clock
        self._say = say
        self._said = ""
        self._newest: Image | None = None
        self._ended = threading.Event()
        self.errors = 0
        self.missed = 0
        """Images that nobody took before the next."""
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def take(self) -> Image | None:
        """The newest image, once; never waits."""
        image, self._newest = self._newest, None
        return image

    def close(self) -> None:
        """Give the camera back, unless its library hangs."""
        self._ended.set()
        self._thread.join(2 * _PATIENCE_S)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._follow()
            except Exception as error:
                self.errors += 1
                self._tell(str(error) or type(error).__name__)
                self._ended.wait(_RETRY_S)

    def _follow(self) -> None:
        camera = self._open()
        try:
            while not self._ended.is_set():
                depth = camera.read(_PATIENCE_S)
                if depth is not None:
                    self._said = ""
                    self.missed += self._newest is not None
                    self._newest = Image(self._clock(), depth)
        finally:
            camera.close()

    def _tell(self, sentence: str) -> None:
        if sentence != self._said:
            self._say(sentence)
        self._said = sentence
