"""The emulated base: attached to a body that a world moves, in the room, and as a program."""

from pathlib import Path

import numpy as np
import pytest

from actors.geometry import Pose
from actors.instant import START, Instant
from firmware_bridge import emulate
from firmware_bridge.emulate import Room, Unicycle
from firmware_bridge.kobuki.base import BodyTruth, EmulatedKobuki
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.wire import (
    FIRMWARE_REQUEST,
    HARDWARE_REQUEST,
    UDID,
    UDID_REQUEST,
    Firmware,
    FrameReader,
    Hardware,
    RequestExtra,
    decode_feedback,
)
from tests.kobuki.drives import Rig


class Passenger:
    """A body that a world moves in steps of its own."""

    def __init__(self, mover: Unicycle) -> None:
        self._mover = mover
        self.wanted = (0.0, 0.0)

    def drive(self, v: float, omega: float) -> None:
        self.wanted = (v, omega)

    def advance(self, now: Instant) -> None:
        """The world does it."""

    def truth(self) -> BodyTruth:
        return self._mover.truth()

    def bumper(self) -> int:
        return 0


def test_a_body_that_a_world_moves_in_long_steps_is_measured_as_if_it_moved_evenly() -> None:
    world = Unicycle(Pose(5.0, 5.0, 1.0), Room(20.0, 20.0))
    body = Passenger(world)
    base = EmulatedKobuki(body, np.random.default_rng(1))
    driver = KobukiDriver(START)
    now = START
    for _ in range(80):
        now = Instant(now + 100_000)
        world.advance(now)
        driver.take(now, base.run(now))
        driver.command(now, 0.4, 0.5)
        base.take(now, driver.due(now))
        world.drive(*body.wanted)
    truth = Pose(5.0, 5.0, 1.0).relative(world.truth().pose)
    odometry = driver.odometry.read()
    assert (odometry.vx, odometry.omega) == pytest.approx((0.4, 0.5), abs=0.012)
    # The last feedback is still on the wire: 8 ms of driving.
    assert (odometry.x, odometry.y) == pytest.approx((truth.x, truth.y), abs=0.012)
    assert driver.odometry.counts.implausible == 0


@pytest.mark.parametrize(("heading", "bits"), [(0.0, 2), (1.0, 1), (-1.0, 4), (3.0, 0), (0.785, 1 | 4)])
def test_the_bumper_has_three_sectors(heading: float, bits: int) -> None:
    corner = heading == 0.785
    body = Unicycle(Pose(3.8, 3.8 if corner else 2.0, heading), Room(4.0, 4.0))
    body.drive(0.3 if heading < 2 else -0.3, 0.0)
    body.advance(Instant(2_000_000))
    assert body.bumper() == bits


def test_a_lifted_base_does_not_move_and_a_deaf_one_drives_on() -> None:
    rig = Rig()
    rig.base.faults.wheel_drop = 3
    rig.run(1.0, (0.3, 0.0))
    rig.base.faults.wheel_drop = 0
    rig.run(4.0, (0.3, 0.0))
    assert rig.body.truth().v == pytest.approx(0.3)
    rig.base.faults.deaf = True
    rig.run(1.0)  # the driver says stand; only a watchdog in the base could help
    assert rig.driver.allowed.v == 0.0
    assert rig.body.truth().v == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        ([], "the following arguments are required: --link"),
        (["--link", "x", "--seed", "-1"], "argument --seed: -1 is negative; it should be 0 or more"),
    ],
)
def test_a_wrong_command_line_is_one_sentence(
    argv: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert emulate.main(["kobuki", *argv]) == 2
    assert capsys.readouterr().err == f"python -m firmware_bridge.emulate kobuki: {sentence}\n"


def test_a_link_that_cannot_be_made_ends_the_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("kept")
    assert emulate.main(["kobuki", "--link", str(path), "--noisy", "--seed", "3"]) == 2
    assert capsys.readouterr().err == (
        f"{path}: there is something that is no link; give a path where a link can be made\n"
    )


def test_a_backlog_of_requests_fits_into_one_feedback() -> None:
    """As a base finds it that had no processor for half a second; each kind is answered once."""
    base = EmulatedKobuki(Unicycle(), np.random.default_rng(1))
    for _ in range(40):
        base._obey(RequestExtra(HARDWARE_REQUEST | FIRMWARE_REQUEST | UDID_REQUEST))
    (packets,) = FrameReader(decode_feedback).take(base.run(Instant(40_000))[:200])[:1]
    kinds = [type(packet) for packet in packets]
    assert [kinds.count(kind) for kind in (Hardware, Firmware, UDID)] == [1, 1, 1]
