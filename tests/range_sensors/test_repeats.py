"""A sensor that says the same twice is noticed; one that measures is not."""

import numpy as np
import pytest

from actors.instant import Instant
from actors.robot_model import load_model
from firmware_bridge.range_sensors.depth import DepthScanner
from firmware_bridge.range_sensors.sensor import Repeats, StillBeams

ANGLES = np.radians(np.arange(360.0))


def test_parts_that_come_again_are_counted_within_a_window() -> None:
    repeats = Repeats(kept=100, window=4, most=2)
    for part in (b"a", b"b", b"c", b"a"):
        repeats.take(part)
    assert not repeats.found
    repeats.take(b"b")
    assert repeats.found
    for part in (b"d", b"e", b"f"):
        repeats.take(part)
    assert not repeats.found


def test_what_was_longer_ago_is_not_remembered() -> None:
    repeats = Repeats(kept=2, window=1, most=1)
    for part in (b"a", b"b", b"c", b"a"):
        repeats.take(part)
    assert not repeats.found
    repeats.forget()
    repeats.take(b"a")
    assert not repeats.found


@pytest.mark.parametrize(("share", "found"), [(0.0, False), (0.2, False), (0.35, True), (1.0, True)])
def test_beams_that_stand_still_are_found_from_three_in_ten_on(share: float, found: bool) -> None:
    beams, random = StillBeams(), np.random.default_rng(2)
    still = np.arange(360) % 20 < 20 * share
    for _ in range(6):
        beams.take(ANGLES, np.where(still, 4000, 4000 + random.integers(0, 3, 360)))
    assert beams.found == found


def test_beams_without_an_echo_do_not_stand_still() -> None:
    beams = StillBeams()
    for _ in range(6):
        beams.take(ANGLES, np.zeros(360, np.int64))
    assert not beams.found


def test_a_camera_that_gives_one_image_for_ever_is_noticed_after_three() -> None:
    scanner, random = DepthScanner(load_model("turtlebot2", "kinect").sensor), np.random.default_rng(1)
    images = [(2000 + random.integers(0, 9, (480, 640))).astype(np.uint16) for _ in range(4)]
    for at, image in enumerate(images):
        scanner.take(Instant(33_000 * at), image)
    assert not scanner.repeats
    for at in range(3):
        assert not scanner.repeats
        scanner.take(Instant(33_000 * (5 + at)), images[at])
    assert scanner.repeats
    assert scanner.sweep() is not None and scanner.sweep() is None
