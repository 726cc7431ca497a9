"""Hardware-in-the-loop runs: the on-board processes of robots with emulated serial devices, in real time."""

import itertools
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import seal
from actors.installation.usage import OptionError, wrong_value
from actors.instant import in_seconds
from actors.messages import PROGRESS, Progress
from actors.processes.launcher import ChildProcess, Launcher, Program, create_launcher
from actors.processes.signals import signals_as_interrupts
from actors.radio.radio_model import radio_parameters
from actors.runtime import typed_json
from actors.runtime.codec import arrived
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import rules
from actors.runtime.isolation.credentials import unix_endpoint
from actors.runtime.isolation.sandbox import print_warning
from actors.runtime.process_setup import SETUP
from actors.runtime.zenoh_bus import ZenohBus, open_mesh
from actors.user_code import FINDER
from deploy.fleet import onboard_processes as layout
from deploy.fleet.collect import collect
from deploy.fleet.onboard_processes import OnboardRobot, Ports
from deploy.fleet.onboard_run import OnboardSupervisor
from deploy.run import progress, swarm
from deploy.run.options import RunOptions
from deploy.run.out_folder import make_folder
from deploy.run.plan import RunPlan, relative_radio_setup, relative_world_setup
from deploy.run.preflight import preflight
from deploy.run.supervisor import Supervisor
from deploy.scenario.events import action_of
from deploy.scenario.tables import Scenario
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.device_lines import BASE, RADIO, RANGE
from firmware_bridge.laboratory.laboratory import LaboratorySetup

ACTIONS: Final = ("jam", "lose", "obstacle")
"""Supported events: those of radio and floor; all others require the conductor of a simulated run."""
_NO_CONDUCTOR: Final = "robots in real time have no conductor"
_FIXED_ODOMETRY: Final = "emulated bases have the odometry errors of a Kobuki, or none"


def check_limits(scenario: Scenario) -> None:
    """Raise OptionError, naming each key, for a scenario that cannot run in real time."""
    actions = [action_of(event) for event in scenario.event]
    unsupported = {f"[[event]] {action}": _NO_CONDUCTOR for action in actions if action not in ACTIONS}
    if "stage" in (scenario.robots.odometry, *(robot.odometry for robot in scenario.robot)):
        unsupported['odometry = "stage"'] = _FIXED_ODOMETRY
    if unsupported:
        what = "; ".join(f"{key}: {reason}" for key, reason in unsupported.items())
        raise OptionError(
            f"--hardware-in-the-loop: unsupported by emulated devices: {what}; "
            "remove it from the scenario, or run without --hardware-in-the-loop"
        )


LABORATORY: Final = "laboratory"
_START_TIMEOUT_S: Final = 60.0
"""Timeout for the start of the emulated devices, s."""


def run(scenario: Scenario, options: RunOptions, launcher: Launcher | None = None) -> RunResult:
    """Run the scenario until no robot has items left or its time is over, and return the result.

    Writes run.json and the task's table of items to `result` in the output folder. `launcher` starts the
    processes; None: as in the options. Raises OptionError for scenarios unsupported in real time and for
    unknown `boards`.
    """
    check_limits(scenario)
    plan = swarm.plan(scenario, options)
    robots = plan.world.ids
    if unknown := [robot for robot in options.boards if robot not in robots]:
        raise wrong_value("--board", unknown[0], f"a robot of the scenario: {', '.join(robots)}")
    simulated = tuple(robot for robot in robots if options.boards and robot not in options.boards)
    for sentence in (plan.warning, *plan.warnings):
        print_warning(sentence)
    make_folder(plan.out)
    plan.folder(LABORATORY).mkdir()
    plan.write_scenario()
    items, task = plan.world.initial_work, plan.world.task.declaration
    with progress.show_progress(plan.world.duration_us, items, task, quiet=options.json) as follow:
        _run_processes(plan, simulated, launcher or create_launcher(options.spawn, reap=False), follow)
    folders = [plan.folder(robot) for robot in robots]
    result = collect(folders, truth=plan.folder(LABORATORY) / "result.json", out=plan.out / "result")
    seal(plan.out)
    return result


def _run_processes(
    plan: RunPlan, simulated: tuple[str, ...], launcher_context: Launcher, on_progress: swarm.OnProgress
) -> None:
    folder = plan.folder(LABORATORY)
    with signals_as_interrupts(), launcher_context as launcher, ExitStack() as stack:
        preflight(plan, launcher)
        devices = _start_devices(plan, simulated, launcher, stack)
        robots = [
            _onboard_robot(plan, index, folder, board=robot.id not in simulated)
            for index, robot in enumerate(plan.world.robots)
        ]
        supervisors = [_start_supervisor(one, launcher, stack) for one in robots]
        buses = [_open_bus(one, stack) for one in robots]
        _supervise(plan, supervisors, buses, devices, on_progress)


def _start_devices(
    plan: RunPlan, simulated: tuple[str, ...], launcher: Launcher, stack: ExitStack
) -> ChildProcess:
    """Start the process that emulates the devices, and wait until they are available."""
    folder = plan.folder(LABORATORY)
    models = {str(path): file for path, file in plan.scenario.models}
    world = relative_world_setup(plan, lambda robot: f"../{models[str(Path(robot.model))]}")
    modules = tuple(map(str, FINDER.task_folders))
    setup = LaboratorySetup(world, relative_radio_setup(plan), simulated, modules)
    (folder / SETUP).write_bytes(typed_json.dump(setup))
    argv = (
        "--setup", str(folder / SETUP), "--links", str(folder / "links"),
        "--result", str(folder / "result.json"), "--with-parent",
    )  # fmt: skip
    log, devices = folder / "laboratory.log", Supervisor(launcher)
    stack.callback(devices.end_all)
    devices.start([Program(LABORATORY, "firmware_bridge.laboratory", argv, log, None)])
    (process,) = devices.running
    deadline = time.monotonic() + _START_TIMEOUT_S
    while "ready" not in (log.read_text() if log.is_file() else "").split("\n"):
        launcher.wait(devices.POLL_S)
        _check_devices(process)
        if time.monotonic() > deadline:
            raise AcrcError(f"the emulated devices did not start within {_START_TIMEOUT_S:g} s")
    return process


def _check_devices(process: ChildProcess) -> None:
    """Raise AcrcError if the process that emulates the devices has exited."""
    if process.exit_code is not None:
        raise AcrcError(
            f"the emulated devices exited with code {process.exit_code}; see {process.program.log}"
        )


def _onboard_robot(plan: RunPlan, index: int, folder: Path, *, board: bool) -> OnboardRobot:
    robot = plan.world.robots[index]
    robot_plan = replace(plan, world=msgspec.structs.replace(plan.world, robots=(robot,)))
    links = folder / "links" / robot.id
    settings = BoardSettings(dict(plan.radio.robots)[robot.id], radio_parameters(plan.radio).channel)
    base, radio, lidar = (str(links / device) for device in (BASE, RADIO, RANGE))
    ports = Ports(base, radio, lidar, settings, board)
    return OnboardRobot(robot_plan, ports, itertools.count().__next__)


def _start_supervisor(robot: OnboardRobot, launcher: Launcher, stack: ExitStack) -> OnboardSupervisor:
    layout.write_folders(robot)
    supervisor = OnboardSupervisor(robot, launcher)
    stack.callback(layout.remove_passwords, robot)
    stack.callback(supervisor.end_all)
    supervisor.start_robot()
    return supervisor


def _open_bus(robot: OnboardRobot, stack: ExitStack) -> ZenohBus:
    folder = robot.folder(layout.BASE).resolve()
    config = rules.client_config(folder / "operator.credentials", unix_endpoint(folder / "router.sock"))
    return stack.enter_context(open_mesh(config, (at(PROGRESS),), patience_s=_START_TIMEOUT_S))


def _supervise(
    plan: RunPlan,
    supervisors: Sequence[OnboardSupervisor],
    buses: Sequence[ZenohBus],
    devices: ChildProcess,
    on_progress: swarm.OnProgress,
) -> None:
    """Supervise the robots until no robot has items left or the time is over."""
    started = time.monotonic()
    left = [len(robot.items) for robot in plan.world.robots]
    done = [0] * len(left)
    unlisted, duration_s = not plan.world.task.declaration.lists_items, in_seconds(plan.world.duration_us)
    while (elapsed := time.monotonic() - started) < duration_s and (unlisted or any(left)):
        for supervisor in supervisors:
            supervisor.restart_exited(0.02)
        _check_devices(devices)
        for index, bus in enumerate(buses):
            for report in arrived(bus, PROGRESS):
                left[index], done[index] = report.left, report.done
        on_progress(Progress(0, round(1e6 * elapsed), sum(left), sum(done), False))
