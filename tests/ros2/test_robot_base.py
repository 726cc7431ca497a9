"""A base behind ROS 2 topics stops after each fault, names the cause, and says what to do; in memory."""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Pose
from actors.instant import Instant, milliseconds
from firmware_bridge.onboard.vehicle import MotionUnknownError
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.message_types import TWIST, TWIST_STAMPED, InvalidMessageError
from firmware_bridge.ros2.names import NO_HASH, Endpoint, EndpointKind
from firmware_bridge.ros2.velocity_commands import CommandFault, choose_type
from tests.ros2.robot_rig import RIVAL, RobotRig, StandstillFigures


class RobotFault(NamedTuple):
    """A fault, the causes of which one must be named, and limits of the command to stand."""

    inject: Callable[[RobotRig], object]
    causes: str
    seconds: float = 0.3
    metres: float = 0.15


def fault(**values: Any) -> Callable[[RobotRig], None]:
    def inject(rig: RobotRig) -> None:
        for name, value in values.items():
            setattr(rig.robot.faults, name, value)

    return inject


def hazard(name: str) -> Callable[[RobotRig], None]:
    return lambda rig: rig.robot.faults.hazards.add(name)


def lose_router(rig: RobotRig) -> None:
    rig.session.connected = False


FAULTS = {
    "scans stop": RobotFault(fault(scan="stopped"), "NO_RANGE_DATA", 0.3),
    "one scan again and again": RobotFault(fault(scan="frozen"), "NO_RANGE_DATA", 0.3),
    "its ranges with new stamps": RobotFault(fault(scan="repeated"), "REPEATED_DATA"),
    "scans without readings": RobotFault(fault(scan="empty"), "NO_RANGE_DATA", 0.3),
    "scans without echo": RobotFault(fault(scan="blind"), "NO_RANGE_DATA"),
    "scans 0.6 s late": RobotFault(fault(scan_delay=0.6), "NO_RANGE_DATA", 0.3),
    "odometry stops": RobotFault(fault(odom="stopped"), "NO_FEEDBACK"),
    "one odometry message again and again": RobotFault(fault(odom="frozen"), "NO_FEEDBACK"),
    "its pose with new stamps": RobotFault(fault(odom="repeated"), "BLOCKED", 0.5, 0.15),
    "clock set forward": RobotFault(fault(clock=17.5), "BASE_CLOCK"),
    "clock set back": RobotFault(fault(clock=5.5), "LATE_DATA NO_FEEDBACK"),
    "messages late": RobotFault(lambda rig: setattr(rig, "latency", milliseconds(400)), "NO_FEEDBACK"),
    "bumper": RobotFault(hazard("bump"), "BUMPER"),
    "cliff": RobotFault(hazard("cliff"), "CLIFF"),
    "wheel drop": RobotFault(hazard("wheel_drop"), "WHEEL_DROP"),
    "stalled wheel": RobotFault(hazard("stall"), "OVERCURRENT"),
    "docked": RobotFault(fault(is_docked=True), "DOCKED", 1.1, 0.4),
    "emergency stop": RobotFault(fault(has_estop=True), "WHEELS_DISABLED"),
    "base ignores commands": RobotFault(fault(ignores_commands=True), "BLOCKED", 0.6),
    "battery nearly empty": RobotFault(fault(battery=0.03), "BATTERY", 1.1, 0.4),
    "another node has a publisher": RobotFault(
        lambda rig: rig.session.graph.append(RIVAL), "OTHER_PUBLISHER"
    ),
    "another node publishes": RobotFault(lambda rig: rig.command_of_another(0.1), "OTHER_PUBLISHER"),
    "base node ends": RobotFault(lambda rig: rig.session.graph.clear(), "NO_SUBSCRIBER"),
    "router ends": RobotFault(lose_router, "NO_FEEDBACK"),
    "guardian ends": RobotFault(lambda rig: rig.guardian.leave(), "NO_GUARDIAN"),
}
TB3_FAULTS = ("scans stop", "its ranges with new stamps", "odometry stops", "base ignores commands")
SLOW_SCANS_S = 0.4
"""A TurtleBot 3's lidar: one and a half periods of 200 ms, and jitter."""


def check_standstill(model: str, name: str) -> StandstillFigures:
    """Assert that the robot stands soon after a fault and that a cause is named; return the figures."""
    rig, case = RobotRig(model), FAULTS[name]
    rig.drive()
    figures = rig.stops(case.inject)
    rig.run(0.3)
    assert rig.causes & set(case.causes.split()), rig.causes
    limit = SLOW_SCANS_S if "scan" in name and model == "turtlebot3_burger" else case.seconds
    is_reachable = name != "router ends"
    assert (figures.told_m <= case.metres and figures.told_s <= limit) or not is_reachable, figures
    return figures


@pytest.mark.parametrize("name", FAULTS)
def test_a_turtlebot_4_stands_soon_after_a_fault_and_names_it(name: str) -> None:
    check_standstill("turtlebot4", name)


@pytest.mark.parametrize("name", TB3_FAULTS)
def test_a_turtlebot_3_stands_soon_after_a_fault_and_names_it(name: str) -> None:
    check_standstill("turtlebot3_burger", name)


@pytest.mark.parametrize(
    "inject",
    [
        *(fault(scan=state) for state in ("alternating", "short")),
        *(fault(imu=state) for state in ("stopped", "frozen", "repeated")),
        fault(battery=0.3),
        lambda rig: rig.session.graph.append(RIVAL._replace(node="/r1/teleop_twist_joy_node")),
    ],
)
def test_it_drives_on_with_harmless_peculiarities(inject: Callable[[RobotRig], object]) -> None:
    rig = RobotRig()
    rig.drive(0.25, 0.2)
    assert rig.stops(inject, 4.0).told_s == math.inf, rig.log[-1]


def test_a_turtlebot_3_drives_with_errors_among_its_readings() -> None:
    rig = RobotRig("turtlebot3_burger")
    rig.drive(0.2, 0.2)
    assert rig.stops(fault(scan="alternating"), 4.0).told_s == math.inf, rig.log[-1]


def test_speeds_are_limited_commands_frequent_and_the_odometry_starts_at_zero() -> None:
    rig = RobotRig()
    rig.robot.shift_odometry(Pose(40.0, -3.0, 2.0))
    rig.drive(2.0)
    x, y, heading = rig.world.pose("r1")
    odometry = rig.vehicle.odometry()
    assert (odometry.x, odometry.y) == pytest.approx((x - 12.0, y - 12.5), abs=0.03)
    assert odometry.heading == pytest.approx(heading, abs=0.02)
    assert max(v for _, v, _ in rig.commands) == pytest.approx(0.306)
    gaps = np.diff([at for at, *_ in rig.commands])
    assert gaps.max() <= milliseconds(50)
    assert any("robot's clock, s ahead:  -> 7.49" in line for line in rig.log)
    assert rig.vehicle.charge() == pytest.approx(0.8)


@pytest.mark.parametrize(
    "inject",
    [
        lambda rig: rig.robot.shift_odometry(Pose(0.0, 2.0, 0.0)),
        lambda rig: rig.robot.reset_odometry(),
        fault(clock=5.5),
    ],
)
def test_unknown_motion_ends_the_base_process_at_a_stop(inject: Callable[[RobotRig], object]) -> None:
    rig = RobotRig()
    rig.drive()
    with pytest.raises(MotionUnknownError):
        rig.stops(inject)
        rig.run(4.0)


def test_a_bumper_permits_backing_off_and_a_backup_limit_forbids_it() -> None:
    rig = RobotRig()
    rig.drive()
    hazard("bump")(rig)
    rig.run(1.0)
    assert rig.world.speed("r1") == pytest.approx(0.0, abs=1e-3) and rig.vehicle.bumper() == 2
    rig.target = (-0.1, 0.0)
    rig.run(1.0)
    assert rig.world.speed("r1") == pytest.approx(0.1, abs=0.01)
    hazard("backup_limit")(rig)
    rig.robot.faults.hazards.discard("bump")
    rig.run(1.0)
    assert (rig.causes, rig.robot.commanded_to_stand) == ({"BACKUP_LIMIT"}, True)
    rig.target = (0.1, 0.0)
    rig.run(1.0)
    assert rig.world.speed("r1") == pytest.approx(0.1, abs=0.01)


def test_after_a_wheel_drop_it_waits_for_a_second_of_standstill() -> None:
    rig = RobotRig()
    rig.drive()
    hazard("wheel_drop")(rig)
    rig.run(2.0)
    rig.robot.faults.hazards.clear()
    rig.run(0.9)
    assert "PUT_DOWN" in rig.causes and rig.robot.commanded_to_stand
    rig.run(1.0)
    assert rig.world.speed("r1") > 0.2


def test_a_standing_robot_gets_no_commands_after_a_second() -> None:
    """A robot that is being undocked is not disturbed."""
    rig = RobotRig()
    fault(is_docked=True)(rig)
    rig.target = (0.2, 0.0)
    rig.run(3.0)
    assert rig.causes == {"DOCKED"} and rig.commands[-1][0] < rig.now - milliseconds(900)


def test_commands_of_another_node_are_named_also_if_it_is_tolerated_or_has_no_token() -> None:
    rig = RobotRig(tolerated=("teleop",))
    rig.session.graph.append(RIVAL)
    rig.drive()
    rig.command_of_another(0.1)
    rig.run(0.2)
    assert rig.vehicle.stop_reasons() == (
        "another node commands velocities: /r1/teleop publishes /r1/cmd_vel; stop that node",
    )
    rig.session.graph.remove(RIVAL)
    rig.command_of_another(0.1)
    rig.run(0.2)
    assert "a node without token publishes /r1/cmd_vel" in rig.vehicle.stop_reasons()[0]
    rig.run(1.2)
    assert not rig.causes


def subscription(kind: str, hash_: str = "") -> Endpoint:
    return Endpoint(EndpointKind.SUBSCRIPTION, "s", "/r1/base", "/r1/cmd_vel", kind, hash_)


OWN, FOREIGN = message_types.type_hash(TWIST), "RIHS01_" + 64 * "0"


@pytest.mark.parametrize(
    ("declared", "setting", "expected"),
    [
        ([], None, "start the robot's base node"),
        ([subscription(TWIST, OWN)], None, (TWIST, OWN)),
        ([subscription(TWIST_STAMPED)], None, (TWIST_STAMPED, message_types.type_hash(TWIST_STAMPED))),
        ([subscription(TWIST, NO_HASH)], "Twist", (TWIST, NO_HASH)),
        ([subscription(TWIST), subscription(TWIST_STAMPED)], "Twist", (TWIST, OWN)),
        ([subscription(TWIST), subscription(TWIST_STAMPED)], None, "set command to"),
        ([subscription(TWIST)], "TwistStamped", "subscriptions declare geometry_msgs/msg/Twist; set"),
        ([subscription("std_msgs/msg/String")], None, "subscriptions declare std_msgs/msg/String"),
        ([subscription(TWIST, FOREIGN)], None, f"another type hash: {FOREIGN}"),
    ],
)
def test_the_type_of_commands_is_the_robots(
    declared: list[Endpoint], setting: str | None, expected: str | tuple[str, str]
) -> None:
    chosen = choose_type(declared, setting)
    if isinstance(expected, tuple):
        assert chosen == expected
    else:
        assert isinstance(chosen, CommandFault) and expected in chosen.sentence


@pytest.mark.parametrize(
    ("voltage", "percentage", "charge"),
    [
        (13.2, 0.9, 0.25),
        (0.0, 0.4, 0.4),
        (math.nan, 40.0, 0.4),
        (math.nan, math.nan, None),
        (0.0, 0.0, None),
    ],
)
def test_the_charge_is_by_voltage_or_percentage(
    voltage: float, percentage: float, charge: float | None
) -> None:
    rig = RobotRig()
    whole = rig.robot._battery_state
    rig.robot._battery_state = lambda stamp: {  # type: ignore[method-assign]
        **whole(stamp),
        "voltage": voltage,
        "percentage": percentage,
    }
    rig.run(0.5)
    assert rig.vehicle.charge() == (None if charge is None else pytest.approx(charge))


def test_other_definitions_and_contradictory_scans_are_refused_and_named() -> None:
    rig = RobotRig()
    rig.drive()
    whole = rig.robot._scan
    rig.robot._scan = lambda stamp: {**whole(stamp), "angle_max": 1.0}  # type: ignore[method-assign]
    rig.run(0.5)
    assert rig.causes == {"NO_RANGE_DATA"} and rig.reader.counts.invalid > 1
    assert any("scan refused: angle_max is 1 rad, but 1080 readings end at" in line for line in rig.log)


def test_any_bytes_from_the_robot_are_survived() -> None:
    rig = RobotRig()
    rig.run(0.3)
    draws = np.random.default_rng(1)

    def corrupted(_: object, payload: bytes) -> bytes:
        data = bytearray(payload)
        for at in draws.integers(0, len(data), draws.integers(1, 6)):
            data[at] = draws.integers(256)
        return bytes(data[: draws.integers(0, len(data) + 1)] if draws.random() < 0.3 else data)

    rig.corrupt = corrupted
    rig.target = (0.3, 0.0)
    with suppress(MotionUnknownError):
        rig.run(5.0)
    assert all(math.isfinite(v) and abs(v) <= 0.3061 for _, v, _ in rig.commands)
    assert any("refused" in line for line in rig.log)


@settings(max_examples=300, deadline=None)
@given(
    kind=st.sampled_from(
        [
            message_types.SCAN,
            message_types.ODOMETRY,
            message_types.IMU,
            message_types.BATTERY,
            message_types.HAZARDS,
            message_types.DOCK,
            message_types.WHEELS,
        ]
    ),
    data=st.binary(max_size=200),
    has_header=st.booleans(),
)
def test_decoding_any_bytes_gives_a_message_or_an_error(kind: str, data: bytes, has_header: bool) -> None:
    with suppress(InvalidMessageError):
        message_types.decode((b"\0\1\0\0" if has_header else b"") + data, kind)


def test_stamps_are_converted_by_the_shortest_latency() -> None:
    rig = RobotRig()
    rig.drive()
    assert Instant(rig.driver.clock.offset or 0) == pytest.approx(-7_500_000 + 3000, abs=8000)
