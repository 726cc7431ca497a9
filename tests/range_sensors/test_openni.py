"""OpenNI2: the sentences, and the calls against a stand-in for the library, as there is no camera here."""

import ctypes
from typing import Any

import numpy as np
import pytest

from firmware_bridge.range_sensors import depth_camera as openni
from firmware_bridge.range_sensors.depth_camera import CameraError, OpenNICamera


class Function:
    """A function of a library, with room for its type."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def __call__(self, *arguments: Any) -> Any:
        return self.answer(*arguments)


class StandIn:
    """Does what a library with a camera of 4 x 2 pixels would; `failing`: the call that does not work."""

    def __init__(self, failing: str = "", said: bytes = b"") -> None:
        self.calls: list[str] = []
        self.settings: dict[int, bytes] = {}
        self.waiting = 0
        self._failing, self._said = failing, said
        self.pixels = np.arange(8, dtype=np.uint16).reshape(2, 4) * 100
        # Rows of 10 bytes, two of them nothing.
        self._data = ctypes.create_string_buffer(b"".join(row.tobytes() + b"\xff\xff" for row in self.pixels))
        self._frame = openni._Frame(size=20, width=4, height=2, stride=10)
        self._frame.data = ctypes.addressof(self._data)

    def __getattr__(self, name: str) -> Function:
        function = Function(lambda *arguments: self._call(name, *arguments))
        setattr(self, name, function)
        return function

    def _call(self, name: str, *arguments: Any) -> Any:
        if name == "oniGetExtendedError":
            return self._said
        self.calls.append(name)
        if name == self._failing:
            return 1
        if name == "oniWaitForAnyStream":
            return self.waiting
        if name in {"oniDeviceOpen", "oniDeviceCreateStream"}:
            arguments[-1]._obj.value = 99
        elif name == "oniStreamSetProperty":
            self.settings[arguments[1]] = bytes(arguments[2]._obj)
        elif name == "oniStreamReadFrame":
            arguments[1]._obj.contents = self._frame
        return 0


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> Any:
        raise OSError("cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(CameraError) as failure:
        OpenNICamera()
    assert str(failure.value) == (
        "the depth camera needs the library OpenNI2, which is not installed; "
        "`sudo apt install libopenni2-0` brings it on Debian and Ubuntu"
    )


def test_without_a_camera_it_says_so_and_lets_go() -> None:
    library = StandIn("oniDeviceOpen", b"\tDeviceOpen using default: no devices found\n\n")
    with pytest.raises(CameraError) as failure:
        OpenNICamera(library=library)
    assert str(failure.value) == (
        "no depth camera is plugged in, or none may be used (DeviceOpen using default: no devices found); "
        "`sudo apt install libopenni2-0 openni2-utils` brings drivers and NiViewer2, which shows whether the "
        "camera works"
    )
    assert library.calls == ["oniInitialize", "oniDeviceOpen", "oniShutdown"]


def test_images_are_read_unmirrored_without_what_pads_their_rows() -> None:
    library = StandIn()
    with OpenNICamera(4, 2, 30, library=library) as camera:
        image = camera.read(0.1)
        library.waiting = 102
        assert camera.read(0.1) is None
    assert image is not None
    assert image.dtype == np.uint16
    assert image.tolist() == library.pixels.tolist()
    assert library.settings[7] == bytes(4)
    assert np.frombuffer(library.settings[3], np.int32).tolist() == [100, 4, 2, 30]
    assert library.calls[-4:] == ["oniStreamStop", "oniStreamDestroy", "oniDeviceClose", "oniShutdown"]


def test_an_image_that_does_not_fit_into_its_bytes_is_refused() -> None:
    library = StandIn()
    library._frame.size = 19
    with OpenNICamera(4, 2, 30, library=library) as camera, pytest.raises(CameraError) as failure:
        camera.read(0.1)
    assert str(failure.value) == (
        "the camera's image has 19 bytes; 4 x 2 pixels of 2 bytes in rows of 10 should fit in"
    )
