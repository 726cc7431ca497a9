"""A robot on board: from the fleet file to running processes, until it is told to stop."""

import functools
import importlib.util
import math
import os
import signal
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.geometry import Point
from actors.installation.usage import command, wrong_value
from actors.installation.version import software
from actors.processes.launch import Child, Launcher, launcher
from actors.processes.robot_logs import last_lines
from actors.processes.signals import signals_as_interrupts
from actors.robot.behaviour.foreign import Permit
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import choose
from actors.runtime.process_table import glance
from deploy.fleet import onboard as layout
from deploy.fleet.doctor import finding, keys
from deploy.fleet.fleet_file import Fleet, FleetRobot, own_code
from deploy.fleet.onboard import EpochCounter, Onboard, Ports
from deploy.run.options import RunOptions
from deploy.run.out_folder import claim, writing
from deploy.run.plan import RunPlan, ScenarioCopy
from deploy.run.supervisor import RestartPolicy, Supervisor, exit_in_words
from firmware_bridge.beeclick.reception import BoardSettings
from firmware_bridge.kobuki import guardian
from firmware_bridge.onboard import last_pose

ONBOARD: Final = RestartPolicy(starts=5, within_s=60.0)
"""Own choice: a fault that comes back at once is no accident; then systemd starts the whole robot again."""


class OnboardSupervisor(Supervisor):
    """One robot's three processes; a base that ends takes the others along, for it is their router."""

    START_S: Final = 120.0
    """How long a base may take to listen; after that it hangs, and is killed."""
    GRACE_S = 5.0
    RESUMES = False

    def __init__(
        self,
        onboard: Onboard,
        launcher: Launcher,
        say: Callable[[str], None] = lambda sentence: None,
        policy: RestartPolicy = ONBOARD,
        poll: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(launcher, policy, say, poll)
        self._onboard = onboard
        self._withdraw = launcher.withdraw
        self._count = {layout.BASE: 0, layout.BRIDGE: 0, onboard.robot.id: 0}
        self._current: dict[str, Child] = {}
        """The newest process of each."""
        self._losses: dict[Path, str] = {}
        """What was said of recordings that are not whole."""

    @property
    def restarts(self) -> int:
        """Starts beyond the first of each."""
        return sum(max(0, count - 1) for count in self._count.values())

    @property
    def base_pid(self) -> int | None:
        """Of the base process; None while there is none."""
        base = self._current.get(layout.BASE)
        return None if base is None or base.exit_code is not None else base.pid

    def start_robot(self) -> None:
        """Start base, bridge and robot."""
        self._withdraw(self._onboard.router)
        issued = layout.issue(self._onboard)
        self._start(layout.BASE)
        socket = issued.sockets[layout.BRIDGE]
        deadline = time.monotonic() + self.START_S
        while not socket.exists():
            self._launcher.wait(0.005)
            if time.monotonic() > deadline:
                self._current[layout.BASE].send(signal.SIGKILL)
            self._poll()
            if self._current[layout.BASE].exit_code is not None:
                return  # look() restarts it, or gives up
        self._start(layout.BRIDGE)
        self._start(self._onboard.robot.id)

    def look(self, patience_s: float) -> bool:
        """Wait so long, and start again what has ended; False once the base has ended as it was told to.

        Raises AcrcError when the budget is used up.
        """
        self._launcher.wait(patience_s)
        self._poll()
        self._tell_losses()
        ended = [name for name, child in self._current.items() if child.exit_code is not None]
        if not ended:
            return True
        if all(self._current[name].exit_code == 0 for name in ended):
            self.await_exits([self._current[layout.BASE]])  # it told them to end, and is about to end itself
        if self._current[layout.BASE].exit_code == 0:
            self.end_all()
            return False
        for name in ended:
            self._say(f"{name} has ended {exit_in_words(self._current[name])}")
        self.count_restart(self._onboard.robot.id, ended[0], self._current[ended[0]])
        if layout.BASE in ended:
            self.end_all()
            layout.withdraw(self._onboard)
            self.start_robot()
            return True
        for name in ended:
            self._start(name)
        return True

    def end_all(self) -> None:
        """Stop the vehicle, and end all processes."""
        base = self._current.get(layout.BASE)
        if base is not None and base.exit_code is None:
            base.send(signal.SIGTERM)  # stands, halts the robot, lets the bridge go
            self.await_exits(self._current.values())
        super().end_all()
        self._tell_losses()

    def _start(self, name: str) -> None:
        number = self._count[name]
        self._count[name] += 1
        if name == layout.BASE:
            program = layout.base_program(self._onboard, number)
        elif name == layout.BRIDGE:
            program = layout.bridge_program(self._onboard, number)
        else:
            program = layout.onboard_robot_program(self._onboard, number)
        self.start([program])
        self._current[name] = self._children[-1]

    def _tell_losses(self) -> None:
        """Say which recordings the disk does not take, as each process says it of its own in its log."""
        for name, child in self._current.items():
            record = child.program.record
            if record is None:
                continue
            said = map(child.program.in_our_words, last_lines(child.program.log))
            told = next((line for line in said if line.startswith(f"{record}: ")), None)
            if told is not None and self._losses.get(record) != told:
                self._losses[record] = told
                self._say(f"{name}: {told}")


LOOK_S: Final = 0.05
"""The base process is looked at so often, and stop said, s; own choice."""


class StandIn:
    """Has the base's port while the base process is stopped."""

    def __init__(self, port: str, say: Callable[[str], None]) -> None:
        """`port`: of the base; `say` is told what is done."""
        self._path = port
        self._say = say
        self._port: int | None = None

    def look(self, base: int | None) -> None:
        """Say stop if that process is stopped, if there is one; never waits."""
        found = None if base is None else glance(base)
        if found is None or not found.stopped:
            self._close()
            return
        if self._port is None:
            try:
                self._port = guardian.open_alone(self._path)
            except OSError:
                return  # unplugged: nobody can say it
            self._say("base is stopped (SIGSTOP or a debugger): stop is said in its place")
        if not guardian.say_stop(self._port, guardian.Standstill()):
            self._close()

    def _close(self) -> None:
        if self._port is not None:
            os.close(self._port)
            self._port = None


_SOCKET: Final = "NOTIFY_SOCKET"


class ServiceNotice:
    """The way to systemd, where it has started this process; elsewhere all of it does nothing."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """`environment`: of this process, if not given; systemd says there where it listens."""
        address = (os.environ if environment is None else environment).get(_SOCKET, "")
        self._socket: socket.socket | None = None
        if address[:1] in {"/", "@"}:
            self._address = address.replace("@", "\0", 1) if address[0] == "@" else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ready(self) -> None:
        """All processes have been started."""
        self._say("READY=1")

    def lives(self) -> None:
        """To be called all the time: without it systemd ends the service after a while."""
        self._say("WATCHDOG=1")

    def _say(self, line: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # systemd is busy: the next one will do
                self._socket.sendto(line.encode(), self._address)


AT_START: Final = "start"
"""Where the fleet file says that the robot is switched on."""


@dataclass(frozen=True)
class OnboardOptions:
    """The options of `acrc fleet onboard`."""

    out: Path
    """Absolute path of the folder for everything that the robot writes; must have none of this robot yet."""
    isolate: bool | None = None
    """As for a run; None: where the machine can, and no debugger is wanted."""
    debug_port: int | None = None
    at: str | None = None
    """Where it is told to be: AT_START, or X,Y,HEADING; None: it may have moved since it last knew."""
    modules: tuple[Path, ...] = ()
    """Folders in which a strategy of one's own may be looked for."""


def prepare(fleet: Fleet, name: str, options: OnboardOptions, say: Callable[[str], None]) -> Onboard:
    """What is to be run for the robot `name`. Raises an AcrcError if anything does not exist or fit.

    `say` is told what comes up later, a sentence at a time.
    """
    if options.debug_port is not None and importlib.util.find_spec("debugpy") is None:
        raise AcrcError(
            f"--debugpy: {options.debug_port} needs the Python package debugpy, which is not installed; "
            f"`{command()} add debugpy` brings it"
        )
    pose_file = options.out.parent / f"{name}.pose"
    robot = fleet.robot_named(name)
    if options.at is not None:
        robot = msgspec.structs.replace(robot, start=_told(options.at, robot))
    model = load_model(robot.model, robot.sensor)
    check_pose(load_map(str(fleet.map)), Point(*robot.start[:2]), model.footprint.circumradius, name)
    air = fleet.radio
    settings = BoardSettings(robot.address, air.channel, air.pan, air.power_db)
    keys_folder = None if robot.listen is None else str(fleet.keys_of(name))
    ports = Ports(robot.base, robot.radio, robot.range, settings, listen=robot.listen, keys=keys_folder)
    counter = EpochCounter(name, options.out.parent, say)
    if options.at is not None:
        pose_file.unlink(missing_ok=True)
    return Onboard(
        _plan(fleet, robot, options),
        ports,
        counter.claim,
        options.debug_port,
        pose_file,
        functools.partial(_link_fault, fleet, robot),
    )


def run(prepared: Onboard, say: Callable[[str], None]) -> None:
    """Run until the operator stops it, a signal comes (Interrupted), or the budget of restarts is used up."""
    if prepared.plan.warning:
        say(prepared.plan.warning)
    with writing(prepared.plan.out), signals_as_interrupts(), launcher("exec", reap=False) as launched:
        layout.lay_out(prepared)
        service, in_doubt = ServiceNotice(), last_pose.read(prepared.pose_file) is not None
        operator = OperatorLink(prepared.link_fault, say)
        watch = OnboardSupervisor(prepared, launched, say, poll=service.lives)
        try:
            watch.start_robot()
            service.ready()
            say(f"{prepared.robot.id} is running; it records into {prepared.plan.out}")
            operator.look()
            if in_doubt:
                say(
                    f"{prepared.robot.id} is in doubt about where it is, and stands until its scans say "
                    "that it is where it last was; `--at start` or `--at X,Y,HEADING` tells it"
                )
            stand_in = StandIn(prepared.ports.base, say)
            while watch.look(LOOK_S):
                stand_in.look(watch.base_pid)
                operator.look()
            say(f"{prepared.robot.id} was told to stop")
        finally:
            watch.end_all()
            layout.withdraw(prepared)


def _link_fault(fleet: Fleet, robot: FleetRobot) -> str:
    """Return the fault of the keys with which a laptop may watch the robot; empty without a fault."""
    if robot.listen is None:
        return ""
    found = finding("keys", keys, fleet, robot)
    return "" if found.ok else found.text


class OperatorLink:
    """Says why no laptop can watch the robot, as soon as that is so: keys also end while it drives."""

    PERIOD_S: Final = 600.0
    """Between two looks at the keys."""

    def __init__(self, fault: Callable[[], str], say: Callable[[str], None]) -> None:
        self._fault, self._say = fault, say
        self._next, self._said = 0.0, ""

    def look(self) -> None:
        """Look, if it is time to; to be called again and again."""
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + self.PERIOD_S
        if (fault := self._fault()) and fault != self._said:
            self._say(f"no laptop can watch or stop it: {fault}")
        self._said = fault


def _told(at: str, robot: FleetRobot) -> tuple[float, float, float]:
    """Where the robot is told to be. Raises OptionError."""
    if at == AT_START:
        return robot.start
    try:
        x, y, heading = (float(word) for word in at.split(","))
    except ValueError:
        x = math.nan
    if not math.isfinite(x) or not (math.isfinite(y) and math.isfinite(heading)):
        raise wrong_value(
            "--at", at, f"{AT_START}, or X,Y,HEADING in m and rad, map frame, such as 12.0,5.0,1.57"
        )
    return x, y, heading


def new_folder(runs: Path) -> Path:
    """A new folder in `runs` named after the time in UTC, made; a clock that is set back does not matter."""
    return claim(runs, time.strftime("%Y%m%d-%H%M%S", time.gmtime()))


def _plan(fleet: Fleet, robot: FleetRobot, options: OnboardOptions) -> RunPlan:
    choice = choose(options.isolate, debugged=options.debug_port is not None)
    return RunPlan(
        **vars(fleet.swarm(robot)),
        options=RunOptions(options.out, speed="1", modules=own_code(fleet, Permit(options.modules))),
        scenario=ScenarioCopy("", ()),
        commit=software(),
        isolate=choice.isolate,
        warning=choice.warning,
    )
