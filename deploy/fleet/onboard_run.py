"""Execution of a robot on board: from the fleet file to supervised processes, until it is stopped."""

import functools
import importlib.util
import math
import os
import signal
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.installation.usage import command_name, wrong_value
from actors.installation.version import software_version
from actors.processes.launcher import ChildProcess, Launcher, create_launcher
from actors.processes.robot_logs import last_lines
from actors.processes.signals import signals_as_interrupts
from actors.robot.behaviour.code_permit import Permit
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import PACKET_KEY_FILE
from actors.runtime.isolation.sandbox import choose_isolation
from actors.runtime.process_table import process_state
from deploy.fleet import onboard_processes as layout
from deploy.fleet.doctor import check_keys, run_check
from deploy.fleet.fleet_file import Fleet, FleetRobot, user_code_folders
from deploy.fleet.onboard_processes import EpochCounter, OnboardRobot, Ports
from deploy.run.options import RunOptions, router_link
from deploy.run.out_folder import claim, convert_write_errors
from deploy.run.plan import RunPlan, ScenarioCopy, ros2_program
from deploy.run.supervisor import Supervisor, exit_description
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.kobuki import guardian
from firmware_bridge.onboard import last_pose
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.serial_port import Say, changed_only

_MAX_RESTARTS: Final = 5
"""Maximum number of restarts within `_RESTART_PERIOD_S`, our choice; above it the supervisor exits and
systemd restarts the whole robot."""
_RESTART_PERIOD_S: Final = 60.0


class OnboardSupervisor(Supervisor):
    """Supervisor of one robot's three processes; restarts all if the base, their router, exits."""

    START_S: Final = 120.0
    """Timeout for the start of the base, s; afterwards it is killed."""
    GRACE_S = 5.0
    CONTINUES_STOPPED = False

    def __init__(
        self,
        onboard: OnboardRobot,
        launcher: Launcher,
        say: Say = lambda sentence: None,
        poll: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(launcher, say, poll)
        self._onboard = onboard
        self._withdraw = launcher.withdraw
        self._programs = {
            layout.BASE: layout.base_program,
            layout.BRIDGE: layout.bridge_program,
            onboard.robot.id: layout.onboard_robot_program,
        }
        self._count = Counter[str]()
        """Number of starts by name."""
        self._restart_times = deque[float](maxlen=_MAX_RESTARTS + 1)
        self._current: dict[str, ChildProcess] = {}
        """Latest process by name."""
        self._losses: dict[Path, str] = {}
        """Last reported warning about each incomplete recording."""

    @property
    def restarts(self) -> int:
        """Number of restarts of all processes."""
        return self._count.total() - len(self._count)

    @property
    def base_pid(self) -> int | None:
        """PID of the base process; None if it is not running."""
        base = self._current.get(layout.BASE)
        return None if base is None or base.exit_code is not None else base.pid

    def start_robot(self) -> None:
        """Start base, bridge and robot program."""
        self._withdraw(self._onboard.router)
        issued = layout.issue_passwords(self._onboard)
        self._start(layout.BASE)
        socket = issued.sockets[layout.BRIDGE]
        deadline = time.monotonic() + self.START_S
        while not socket.exists():
            self._launcher.wait(0.005)
            if time.monotonic() > deadline:
                self._current[layout.BASE].send(signal.SIGKILL)
            self._poll()
            if self._current[layout.BASE].exit_code is not None:
                return  # restart_exited restarts it or raises
        self._start(layout.BRIDGE)
        self._start(self._onboard.robot.id)
        if (options := self._onboard.plan.options).ros2:
            link = router_link(options.router)
            self.start([ros2_program(options.out, link, self._onboard.robot.id)])

    def restart_exited(self, wait_s: float) -> bool:
        """Wait `wait_s`, then restart exited processes; return False after the base's normal exit.

        Raises AcrcError if the restart limit is exceeded.
        """
        self._launcher.wait(wait_s)
        self._poll()
        self._report_losses()
        exited = [name for name, child in self._current.items() if child.exit_code is not None]
        if not exited:
            return True
        if all(self._current[name].exit_code == 0 for name in exited):
            self.await_exits([self._current[layout.BASE]])  # the base stopped them and is about to exit
        if self._current[layout.BASE].exit_code == 0:
            self.end_all()
            return False
        for name in exited:
            self._say(f"{name} exited {exit_description(self._current[name])}")
        self._count_restart(exited[0])
        if layout.BASE in exited:
            self.end_all()
            layout.remove_passwords(self._onboard)
            self.start_robot()
        else:
            for name in exited:
                self._start(name)
        return True

    def end_all(self) -> None:
        """Stop the vehicle and terminate all processes."""
        base = self._current.get(layout.BASE)
        if base is not None and base.exit_code is None:
            base.send(signal.SIGTERM)  # stops the wheels, the robot program and the bridge
            self.await_exits(self._current.values())
        super().end_all()
        self._report_losses()

    def _count_restart(self, name: str) -> None:
        """Count a restart of the process `name`; end all and raise AcrcError above the limit."""
        now = time.monotonic()
        self._restart_times.append(now)
        if len(self._restart_times) > _MAX_RESTARTS and self._restart_times[0] >= now - _RESTART_PERIOD_S:
            self.end_all()
            raise AcrcError(
                f"{self._onboard.robot.id}: its processes were started {_MAX_RESTARTS} times within "
                f"{_RESTART_PERIOD_S:g} s, and {name} has ended again {exit_description(self._current[name])}"
            )

    def _start(self, name: str) -> None:
        number = self._count[name]
        self._count[name] += 1
        self.start([self._programs[name](self._onboard, number)])
        self._current[name] = self._children[-1]

    def _report_losses(self) -> None:
        """Report recordings that could not be written, as logged by the processes."""
        for name, child in self._current.items():
            record = child.program.record
            if record is None:
                continue
            log_lines = map(child.program.outside_text, last_lines(child.program.log))
            loss = next((line for line in log_lines if line.startswith(f"{record}: ")), None)
            if loss is not None and self._losses.get(record) != loss:
                self._losses[record] = loss
                self._say(f"{name}: {loss}")


def connect_stop(base: str | Ros2Base) -> guardian.StopHandler:
    """Open a connection for stop commands to a Kobuki's port or a ROS 2 robot. Raises OSError."""
    if isinstance(base, str):
        return guardian.SerialStop(guardian.open_port(base))
    from firmware_bridge.ros2.guardian import RobotStop  # noqa: PLC0415 - Zenoh and rosbags load slowly

    return RobotStop(base, "fallback")


class FallbackStop:
    """Fallback that sends stop commands to the base while the base process is suspended."""

    def __init__(self, connect: Callable[[], guardian.StopHandler], say: Say) -> None:
        """`connect`: opens a connection to the base, or raises OSError. `say`: called with log messages."""
        self._connect = connect
        self._say = say
        self._sender: guardian.StopHandler | None = None

    def update(self, base: int | None) -> None:
        """Send a stop command if the process with PID `base` is suspended; does not block."""
        found = None if base is None else process_state(base)
        if found is None or not found.stopped:
            self._close()
            return
        if self._sender is None:
            try:
                self._sender = self._connect()
            except OSError:
                return  # unplugged
            self._say("base process suspended (SIGSTOP or a debugger): sending stop commands to the wheels")
        self._sender.reset()
        if not self._sender.send():
            self._close()

    def _close(self) -> None:
        if self._sender is not None:
            self._sender.close()
            self._sender = None


READY: Final = "READY=1"
"""Notification that all processes have been started."""
RESET_WATCHDOG: Final = "WATCHDOG=1"
"""Reset of the watchdog of systemd, which otherwise terminates the service."""


def notify_systemd(state: str, environment: Mapping[str, str] = os.environ) -> None:
    """Send a notification (sd_notify(3)); without effect if systemd did not start this process."""
    address = environment.get("NOTIFY_SOCKET", "")
    if address[:1] in {"/", "@"}:
        with (
            suppress(OSError),  # systemd is busy; the next notification suffices
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender,
        ):
            sender.setblocking(False)
            sender.sendto(state.encode(), address.replace("@", "\0", 1) if address[0] == "@" else address)


AT_START: Final = "start"
"""The start pose of the fleet file."""


def prepare(
    fleet: Fleet,
    name: str,
    options: RunOptions,
    say: Say,
    *,
    at: str | None = None,
    debug_port: int | None = None,
) -> OnboardRobot:
    """Check the configuration of the robot `name` and return it ready to run. Raises AcrcError.

    `options`: checked; `out` must not contain a folder of this robot. `modules`: folders from which a user
    strategy may be loaded. `say`: called with later log messages. `at`: pose of the robot, AT_START or
    X,Y,HEADING; None: its last estimate, to be confirmed by scans.
    """
    if debug_port is not None and importlib.util.find_spec("debugpy") is None:
        raise AcrcError(
            f"--debugpy: {debug_port} needs the Python package debugpy; install it with "
            f"`{command_name()} add debugpy`"
        )
    pose_file = options.out.parent / f"{name}.pose"
    robot = fleet.robot_named(name)
    if at is not None:
        robot = msgspec.structs.replace(robot, start=_parse_pose(at, robot))
    radius = load_model(robot.model, robot.sensor).footprint.circumradius
    check_pose(load_map(fleet.map), robot.start_point, radius, name)
    radio = fleet.radio
    settings = BoardSettings(robot.address, radio.channel, radio.pan, radio.power_db)
    keys = fleet.key_folder(name)
    ports = Ports(
        robot.base,
        radio.network or robot.radio,
        robot.range,
        settings,
        board=radio.network is None,
        listen=robot.listen,
        keys=str(keys) if robot.needs_keys else None,
    )
    if at is not None:
        pose_file.unlink(missing_ok=True)
    return OnboardRobot(
        _plan(fleet, robot, options, debugged=debug_port is not None),
        ports,
        EpochCounter(name, options.out.parent, say).claim,
        debug_port,
        pose_file,
        functools.partial(_link_fault, fleet, robot),
        keys / PACKET_KEY_FILE if radio.authenticated else None,
    )


def run(prepared: OnboardRobot, say: Say) -> None:
    """Run until the operator's stop, a signal (Interruption), or an exceeded restart limit (AcrcError)."""
    if prepared.plan.warning:
        say(prepared.plan.warning)
    with (
        convert_write_errors(prepared.plan.out),
        signals_as_interrupts(),
        create_launcher("exec", reap=False) as launcher,
    ):
        layout.write_folders(prepared)
        is_unconfirmed = last_pose.read(prepared.pose_file) is not None
        operator = OperatorAccessCheck(prepared.link_fault, say)
        supervisor = OnboardSupervisor(
            prepared, launcher, say, poll=functools.partial(notify_systemd, RESET_WATCHDOG)
        )
        try:
            supervisor.start_robot()
            notify_systemd(READY)
            say(f"{prepared.robot.id} is running; recordings in {prepared.plan.out}")
            operator.check_if_due()
            if is_unconfirmed:
                say(
                    f"{prepared.robot.id} waits until its scans confirm its last pose; to set the pose, use "
                    "`--at start` or `--at X,Y,HEADING`"
                )
            fallback = FallbackStop(functools.partial(connect_stop, prepared.ports.base), say)
            while supervisor.restart_exited(supervisor.POLL_S):
                fallback.update(supervisor.base_pid)
                operator.check_if_due()
            say(f"{prepared.robot.id} stopped by the operator")
        finally:
            supervisor.end_all()
            layout.remove_passwords(prepared)


def _link_fault(fleet: Fleet, robot: FleetRobot) -> str:
    """Return the fault of the keys for the operator's laptop; empty if they are valid."""
    if robot.listen is None:
        return ""
    found = run_check("keys", check_keys, fleet, robot)
    return "" if found.ok else found.text


class OperatorAccessCheck:
    """Periodic check of the keys for the operator's laptop, which may expire during a run."""

    PERIOD_S: Final = 600.0
    """Period of the check, s."""

    def __init__(self, fault: Callable[[], str], say: Say) -> None:
        self._fault, self._say, self._next = fault, changed_only(say), 0.0

    def check_if_due(self) -> None:
        """Check the keys if the period has passed; report a new fault."""
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + self.PERIOD_S
        fault = self._fault()
        self._say(fault and f"laptops cannot connect to watch or stop the robot: {fault}")


def _parse_pose(at: str, robot: FleetRobot) -> tuple[float, float, float]:
    """Parse the pose in `--at`. Raises OptionError."""
    if at == AT_START:
        return robot.start
    with suppress(ValueError):
        x, y, heading = map(float, at.split(","))
        if math.isfinite(x + y + heading):
            return x, y, heading
    raise wrong_value(
        "--at", at, f"{AT_START}, or X,Y,HEADING in m and rad, map frame, such as 12.0,5.0,1.57"
    )


def new_folder(runs: Path) -> Path:
    """Create a new folder in `runs`, named after the time in UTC; unique even if the clock was set back."""
    return claim(runs, time.strftime("%Y%m%d-%H%M%S", time.gmtime()))


def _plan(fleet: Fleet, robot: FleetRobot, options: RunOptions, *, debugged: bool) -> RunPlan:
    choice = choose_isolation(options.isolate, debugged=debugged)
    return RunPlan(
        **vars(fleet.swarm(robot)),
        options=replace(options, modules=user_code_folders(fleet, Permit(options.modules))),
        scenario=ScenarioCopy("", ()),
        commit=software_version(),
        isolate=choice.isolate,
        warning=choice.warning,
    )
