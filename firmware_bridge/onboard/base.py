"""Base process: `python -m firmware_bridge.onboard.base SETUP`.

It is the router of its robot, as the world is the router of a simulated swarm.
"""

import functools
import os
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from socket import SOCK_STREAM
from typing import TYPE_CHECKING

from actors.geometry import Pose
from actors.instant import Instant, seconds
from actors.robot_model import RangeSensor, load_model
from actors.runtime.background import BackgroundLog, BackgroundRecorder, write_stderr
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials
from actors.runtime.isolation.tls import onboard_router_config
from actors.runtime.linux import die_with_parent
from actors.runtime.process import ActorProcess, run_actor, run_note
from actors.runtime.process_setup import read_setup, setup_parser
from actors.runtime.shell import Shell
from actors.runtime.zenoh_bus import SelectableBus
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.onboard.base_core import BaseCore
from firmware_bridge.onboard.device_loop import OPENNI, BaseProcessSetup, BaseSetup, Clock, run_event_loop
from firmware_bridge.onboard.last_pose import FEEDBACK_LOSS_SPREAD, PoseWriter
from firmware_bridge.onboard.vehicle import (
    DepthCameraDevice,
    GuardianLink,
    LidarDevice,
    MotionUnknownError,
    RangeDevice,
    TurtleBot,
)
from firmware_bridge.range_sensors.depth import CameraFeed, DepthScanner, OpenNICamera
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.serial_port import KOBUKI, RPLIDAR, Say, SerialPort

if TYPE_CHECKING:
    from firmware_bridge.onboard.ros2_robot import Ros2Robot


def create_vehicle(setup: BaseSetup, clock: Clock, say: Say) -> "TurtleBot | Ros2Robot":
    """Create the vehicle on the ports of the set-up or on its ROS 2 topics, which may be missing at first."""
    model = load_model(setup.model, setup.sensor)
    if isinstance(setup.base, Ros2Base):
        from firmware_bridge.onboard.ros2_robot import create_ros2_robot  # noqa: PLC0415 - needs rosbags

        return create_ros2_robot(setup.base, model, clock.now, say)
    base = functools.partial(SerialPort, setup.base, KOBUKI)
    driver, range_device = KobukiDriver(clock.now()), _create_ranger(setup.range, model.sensor, clock, say)
    return TurtleBot(
        base, driver, range_device, GuardianLink(setup.base), say, model.sensor.mount, model.battery
    )


def _create_ranger(port: str | None, sensor: RangeSensor, clock: Clock, say: Say) -> RangeDevice | None:
    if port is None:
        return None
    if port == OPENNI:
        scanner = DepthScanner(sensor)
        return DepthCameraDevice(CameraFeed(OpenNICamera, clock.now, say), scanner, say)
    lidar = Rplidar(sensor, clock.now())
    return LidarDevice(functools.partial(SerialPort, port, RPLIDAR), lidar, say)


class Base:
    """The base process around its core."""

    def __init__(self, setup: BaseSetup, clock: Clock) -> None:
        now = clock.now()
        self._clock = clock
        self._log = BackgroundLog(write_stderr)
        self._vehicle = create_vehicle(setup, clock, self._log.say)
        self._pose_writer = PoseWriter(Path(setup.last_pose), now)
        initial = self._pose_writer.initial
        start = Pose(*(setup.start if initial is None else initial.pose))
        self.core = BaseCore(setup.id, setup.step_us, now, start, len(setup.items), self._vehicle)
        self.core.answer_timeout = None if setup.patience_s is None else seconds(setup.patience_s)

    def drive(self, shell: Shell, bus: SelectableBus) -> None:
        """Run until stopped; the vehicle stands when this returns or raises."""
        core = self.core
        previous_handler = signal.signal(signal.SIGTERM, lambda *_: core.stop())
        try:
            run_event_loop(shell, bus, core, self, self._clock)
        except MotionUnknownError:
            self._vehicle.close()
            self._pose_writer.add_spread(FEEDBACK_LOSS_SPREAD)
            raise
        finally:
            self._vehicle.close()
            self._pose_writer.close()
            self._log.close()
            signal.signal(signal.SIGTERM, previous_handler)

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""
        return self._vehicle.descriptors()

    def serve(self, now: Instant) -> None:
        """Exchange bytes with the devices. Raises MotionUnknownError."""
        self._vehicle.serve(now)
        self._vehicle.check_odometry()
        if self.core.last_estimate is not None:
            self._pose_writer.store(now, *self.core.last_estimate)


def check_endpoint(listen: str | None, key: str = "listen") -> None:
    """Raise AcrcError if the endpoint `tls/HOST:PORT` is unavailable for listening."""
    if listen is None:
        return
    host, _, port = listen.removeprefix("tls/").rpartition(":")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host.strip("[]"), int(port), type=SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise AcrcError(
            f"{listen}: cannot listen there: {why}; stop the program that uses the port, or change `{key}` "
            "in the fleet file"
        ) from None


def main(argv: Sequence[str]) -> int:
    """Run the base process; return the exit code."""
    try:
        file = setup_parser("firmware_bridge.onboard.base", "Drive a TurtleBot.").parse_args(argv).setup
        process_setup, folder = read_setup(file, BaseProcessSetup, "a base"), file.parent
        setup, router = process_setup.actor, folder / process_setup.process.router
        if process_setup.process.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        router_credentials = credentials.read_router_file(router)
        base = Base(setup.resolve_paths(folder), Clock())
        process = ActorProcess(
            core=base.core,
            listens=base.core.listens(),
            run=run_note("base", setup, process_setup.process.commit),
            bus=SelectableBus,
            drive=base.drive,
            outcome=base.core.report,
        )
        config = onboard_router_config(router_credentials, Path(setup.keys or ""), setup.listen)
        try:
            check_endpoint(setup.listen)
            recorder = BackgroundRecorder(folder / process_setup.process.record, setup.step_us)
            return run_actor(
                process, recorder, config, lambda: credentials.publish_sockets(router_credentials)
            )
        finally:
            credentials.remove_router_file(router)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
