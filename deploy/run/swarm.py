"""Execution of a run: plan, hosts, preflight, processes (or one process), result."""

import contextlib
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from acrc_testbed.results import summary
from acrc_testbed.results.outcome import write_items
from acrc_testbed.results.result import RunResult, gather_result
from acrc_testbed.results.seal import remote_recordings, seal
from actors.floor.map_file import load_map
from actors.installation.usage import wrong_value
from actors.installation.version import software_version
from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress
from actors.orders import ItemAssignment
from actors.processes import monitor
from actors.processes.launcher import ChildProcess, Launcher, create_launcher, scratch_folder
from actors.processes.monitor import ResourceMonitor, StepDelays, Timeout
from actors.processes.robot_logs import check_names, print_output, printing_new_lines, program_output
from actors.processes.signals import Interruption, signals_as_interrupts
from actors.processes.watchdog import run_watchdog
from actors.robot import assembly
from actors.robot.behaviour.handover import dry_run
from actors.robot_model import load_model
from actors.runtime import typed_json
from actors.runtime.captured_output import captured_by
from actors.runtime.core import at
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import FailureNote, failure_note, own_frames
from actors.runtime.isolation import rules
from actors.runtime.isolation.mounts import code_entries, hidden_paths
from actors.runtime.isolation.sandbox import IsolationChoice, choose_isolation, print_warning
from actors.runtime.recording import RecordingError
from actors.runtime.shell import MemoryBus
from actors.runtime.zenoh_bus import open_mesh
from actors.user_code import expect_hashes, set_folders
from deploy.hosts.address import parse_listen
from deploy.run import progress
from deploy.run.memory_swarm import MemorySwarm, raise_on_hard_exit
from deploy.run.options import RunOptions, router_link
from deploy.run.out_folder import check_new
from deploy.run.plan import (
    CONTROL_ADDRESS,
    DebuggedRobot,
    RunPlan,
    control_program,
    issue_credentials,
    observer_program,
    radio_program,
    remove_credentials,
    robot_program,
    ros2_program,
    router_file,
    scenario_copy,
    shared_arguments,
    world_program,
    write_robot_folder,
    write_run_folder,
)
from deploy.run.supervisor import RunSupervisor
from deploy.scenario.resolve import ResolvedScenario, Swarm, resolve, robot_setup
from deploy.scenario.survey import scenario_warnings
from deploy.scenario.tables import Scenario

if TYPE_CHECKING:
    from deploy.hosts.allocation import HostPool
    from deploy.hosts.run_hosts import RunHosts

_KEYS: Final = "keys"
"""Folder of this computer's keys, in the world's folder."""
_MAX_CODE_BYTES: Final = 64 << 20
"""Maximum size of a strategy's code for hosts, bytes."""


def allocated_hosts(options: RunOptions) -> AbstractContextManager["HostPool | None"]:
    """Return a context of the hosts for `options.on`; None if the robots run here. Raises AcrcError."""
    if not options.on:
        return nullcontext()
    from deploy.hosts.allocation import allocate_hosts  # noqa: PLC0415

    return allocate_hosts(options.on, parse_listen(options.listen) if options.listen else None)


def started_hosts(plan: RunPlan, pool: "HostPool | None") -> AbstractContextManager["RunHosts | None"]:
    """Return a context of the hosts with started agents; None if the robots run here. Raises AcrcError."""
    if pool is None:
        return nullcontext()
    from deploy.hosts.allocation import distribute_robots  # noqa: PLC0415
    from deploy.hosts.run_hosts import HostSettings, RunHosts  # noqa: PLC0415

    robots_by_host = distribute_robots(
        plan.world.ids, {name: offer.cores for name, offer in pool.offers.items()}
    )
    shared = HostSettings(
        out=plan.out,
        spawn=plan.options.spawn,
        limits=plan.options.limits,
        timeout_s=plan.timeout.step_s,
        share=lambda chosen: tuple(shared_arguments(plan, Path(), chosen)),
        leave=plan.options.leave,
        code=tuple(tuple(_code_files(folder, plan.options.hidden)) for folder in plan.options.modules),
    )
    return closing(RunHosts(pool, robots_by_host, plan.folder("world").resolve() / _KEYS, shared))


def _code_files(folder: Path, hidden: tuple[Path, ...]) -> Iterator[tuple[str, Path]]:
    """Yield the files of a strategy's folder that a robot may read. Raises AcrcError."""
    left = _MAX_CODE_BYTES
    for entry in code_entries(folder.absolute(), hidden_paths(hidden)):
        for path in sorted(entry.rglob("*")) if entry.is_dir() else [entry]:
            if path.is_file() and not path.is_symlink() and "__pycache__" not in path.parts:
                left -= path.stat().st_size
                if left < 0:
                    raise AcrcError(
                        f"--modules: {folder}: has more than {_MAX_CODE_BYTES >> 20} MiB of files for hosts; "
                        "give a folder with the strategy's code only"
                    )
                yield path.relative_to(folder.absolute()).as_posix(), path


_HUNG: Final = re.compile(r'^Timeout.*?File "([^"\n]*)", line (\d+)', re.DOTALL | re.MULTILINE)
"""Position of the main thread in faulthandler's output."""


@dataclass(frozen=True)
class PreflightLimits:
    """Time limits of a preflight."""

    patience_s: float = 120.0
    """Timeout of the creation of a robot, s, including the first compilation of kernels."""
    grace_s: float = 5.0
    """Additional time for a process that ignores its timeout, s."""


def preflight(plan: RunPlan, launcher: Launcher, limits: PreflightLimits = PreflightLimits()) -> None:
    """Create the first robot in a separate process and a temporary folder.

    Raises AcrcError if that fails, hangs or exits; the traceback of an unexpected error is printed first.
    """
    robot = plan.world.robots[0]
    with scratch_folder() as folder:
        options = replace(plan.options, out=folder)
        trial = replace(plan, options=options, debug=plan.debug and DebuggedRobot("", ""))
        write_robot_folder(trial, robot)
        program = robot_program(trial, robot, ProcessOrder(robot.id, 0), 0)
        program = replace(program, argv=(*program.argv, "--preflight", f"{limits.patience_s:g}"))
        child = launcher.start(program)
        try:
            _await_exit(child, launcher, limits)
            hung = child.exit_code is None
        finally:
            child.send(signal.SIGKILL)
            _await_exit(child, launcher, replace(limits, patience_s=0.0))
        _check_preflight(plan, child, limits, hung=hung)


def preflight_in_process(resolved: ResolvedScenario, modules: Sequence[Path]) -> None:
    """Create and discard the first robot's behaviour in this process, for a run in memory.

    Raises AcrcError for wrong settings, areas or equipment, for a missing entry, and for an error in the
    strategy's code, with its frames.
    """
    name, robot = resolved.scenario.run.strategy, resolved.world.robots[0]
    setup = robot_setup(resolved, robot)
    model = load_model(robot.model, robot.sensor)
    floor = assembly.floor(load_map(resolved.world.map), model, setup.stack)
    start = assembly.start(setup, model, floor)
    # with --json, standard output is for the result only; modules imported here keep their streams
    set_folders(modules)
    with contextlib.redirect_stdout(sys.stderr), captured_by(None), raise_on_hard_exit():
        try:
            dry_run(resolved.behaviour, start)
        except AcrcError:
            raise
        except Exception as error:
            which = repr(name) if name == resolved.behaviour else f"{name!r}, {resolved.behaviour!r},"
            cause = failure_note("", 0, error).cause
            sentence = f"strategy {which.rstrip(',')}, preflight for {robot.id}: {cause}"
            raise AcrcError(f"{sentence}\n{own_frames(error)}".rstrip()) from error


def _await_exit(child: ChildProcess, launcher: Launcher, limits: PreflightLimits) -> None:
    deadline = time.monotonic() + limits.patience_s + limits.grace_s
    while child.exit_code is None and time.monotonic() < deadline:
        launcher.wait(0.05)


def _check_preflight(plan: RunPlan, child: ChildProcess, limits: PreflightLimits, *, hung: bool) -> None:
    """Raise AcrcError unless the process has created its robot.

    `hung`: it was killed after the timeout.
    """
    context = f"strategy {plan.behaviour!r}, preflight for {child.program.actor}"
    notes = _notes(child)
    if "failure" in notes:
        note = msgspec.json.decode(notes["failure"], type=FailureNote)
        if note.expected:
            raise AcrcError(printable(note.cause))
        print_output(program_output(child.program))
        raise AcrcError(f"{context}: {printable(note.cause)}")
    if child.exit_code == 0 and "run" in notes:
        return
    output = program_output(child.program)
    place = _HUNG.search(output)
    if place is not None:
        where = f"{Path(place[1]).name}:{place[2]}"
        raise AcrcError(f"{context}: not finished after {limits.patience_s:g} s; it is at {where}")
    if child.exit_code == 2 and output.strip():  # an error before the strategy was loaded
        raise AcrcError(output.strip().splitlines()[-1])
    print_output(output)
    if hung:
        raise AcrcError(f"{context}: not finished after {limits.patience_s + limits.grace_s:g} s")
    assert child.exit_code is not None
    if child.exit_code < 0:
        number = signal.Signals(-child.exit_code)
        raise AcrcError(f"{context}: its process was killed by {number.name}")
    raise AcrcError(f"{context}: its process ended with exit code {child.exit_code}")


def _notes(child: ChildProcess) -> Mapping[str, str]:
    try:
        return child.notes()
    except (OSError, RecordingError):
        return {}


OPERATOR: Final = "operator"
"""User name of this process on the mesh."""
OnProgress = Callable[[Progress], None]


def run(scenario: Scenario, options: RunOptions, launcher: Launcher | None = None) -> RunResult:
    """Run the scenario; write run.json and the table of items, and seal the folder. Raises AcrcError.

    `launcher`: if already started.
    """
    with allocated_hosts(options) as pool:
        prepared = plan(scenario, options, None if pool is None else pool.isolation_fault)
        for sentence in (prepared.warning, *(() if options.json else prepared.warnings)):
            print_warning(sentence)
        items = prepared.world.initial_work
        given = (timed.order for timed in prepared.world.events)
        items += sum(len(order.items) for order in given if isinstance(order, ItemAssignment))
        words = prepared.world.task.declaration
        quiet = options.json or prepared.debug is not None  # the debugger uses the terminal
        check_names(options.log, prepared.world.ids, "--log")
        with (
            progress.show_progress(prepared.world.duration_us, items, words, quiet=quiet) as follow,
            printing_new_lines(options.out, options.log) as look,
        ):

            def on_progress(message: Progress) -> None:
                follow(message)
                look()

            if options.bus == "memory":
                result = run_in_memory(prepared, on_progress)
            else:
                result = run_processes(prepared, options.spawn, on_progress, launcher, pool)
    seal(options.out, {name: one.sha256 for name, one in remote_recordings(options.out).items()})
    return result


def plan(scenario: Scenario, options: RunOptions, hosts_fault: str | None = None) -> RunPlan:
    """Plan a run: resolve the scenario, choose the isolation, check the strategy.

    `hosts_fault`: why robots cannot be isolated on hosts; None if they can. For a run in memory the
    strategy's code is executed once in this process; its exceptions are raised as AcrcErrors.
    """
    memory = options.bus == "memory"
    choice = IsolationChoice(False) if memory else choose_isolation(options.isolate, elsewhere=hosts_fault)
    resolved = resolve(scenario)
    _check_robots("--robot", options.followed, resolved.world.ids)
    debug = None
    if options.debug is not None:
        _check_robots("--debug", [options.debug], resolved.world.ids)
        debug = DebuggedRobot(options.debug, "" if memory else os.ttyname(0))
    planned = RunPlan(
        **{one.name: getattr(resolved, one.name) for one in fields(Swarm)},
        options=options,
        scenario=scenario_copy(resolved, options),
        commit=software_version(),
        isolate=choice.isolate,
        warning=choice.warning,
        warnings=scenario_warnings(resolved),
        timeout=Timeout(step_s=options.timeout_s if options.debug is None else math.inf),
        debug=debug,
    )
    if memory:
        expect_hashes(options.recorded)
        with run_watchdog(planned.timeout.step_s) if planned.has_user_code else nullcontext():
            preflight_in_process(resolved, options.modules)
    return planned


def _check_robots(option: str, robots: Iterable[str], known: Sequence[str]) -> None:
    for robot in robots:
        if robot not in known:
            raise wrong_value(option, robot, f"one of {', '.join(known)}")


def run_in_memory(plan: RunPlan, on_progress: OnProgress, bus: MemoryBus | None = None) -> RunResult:
    """Run all actors in this process; return the result."""
    started = time.time()
    write_run_folder(plan)
    swarm = MemorySwarm(plan, bus or MemoryBus(), on_progress)
    try:
        with signals_as_interrupts():
            swarm.run()
    except Interruption:
        _report_delays(swarm.held_up)
        raise
    return _write_result(plan, swarm, started, "memory", time.process_time())


def run_processes(
    plan: RunPlan,
    spawn: str,
    on_progress: OnProgress,
    launcher: Launcher | None = None,
    pool: "HostPool | None" = None,
) -> RunResult:
    """Run every actor in its own process; none is left when this returns or raises.

    `launcher`: if already started. `pool`: hosts of the robots.
    """
    started = time.time()
    check_new(plan.out)
    with signals_as_interrupts(), nullcontext(launcher) if launcher else create_launcher(spawn) as active:
        preflight(plan, active)
        write_run_folder(plan)
        with started_hosts(plan, pool) as hosts:
            supervisor = _supervise(plan, active, on_progress, hosts)
    return _write_result(plan, supervisor, started, "zenoh", supervisor.cpu_s + time.process_time())


def _supervise(
    plan: RunPlan, launcher: Launcher, on_progress: OnProgress, hosts: "RunHosts | None"
) -> RunSupervisor:
    """Start the processes and wait for their exit."""
    launcher.withdraw(router_file(plan))
    credentials = issue_credentials(plan, None if hosts is None else hosts.gate)
    robots = {robot.id: robot for robot in plan.world.robots}
    run_launcher = launcher if hosts is None else hosts.launcher(launcher, _say)
    supervisor = RunSupervisor(
        run_launcher,
        lambda order, step: robot_program(plan, robots[order.robot], order, step),
        on_progress,
        plan.timeout,
        ResourceMonitor(plan.options.limits),
        _say,
    )
    try:
        supervisor.start([world_program(plan), radio_program(plan)])
        for words in shared_arguments(plan, Path()) if hosts is None else ():
            launcher.share("actors.robot.program", words, plan.out)
        supervisor.await_file(credentials.sockets[OPERATOR], "world")
        config = rules.client_config(credentials.files[OPERATOR], credentials.endpoint(OPERATOR))
        with open_mesh(config, (at(PROGRESS), at(ROSTER)), between=supervisor.check_all) as bus:
            if hosts is not None:
                hosts.join(supervisor.check, run_launcher.wait)
                hosts.write()
                _say(hosts.sentence)
            _start_observers(plan, supervisor)
            first = (ProcessOrder(robot, 0) for robot in robots)
            supervisor.start([robot_program(plan, robots[order.robot], order, 0) for order in first])
            supervisor.watch(bus)
            if hosts is not None and (load_sentence := hosts.load_sentence):
                _say(load_sentence)
    except Interruption:
        _report_delays(supervisor.held_up)
        raise
    finally:
        supervisor.end_all()
        if hosts is not None:
            hosts.finish(run_launcher.wait)
            hosts.write()
            if remaining_files := hosts.remaining_files:
                _say(remaining_files)
        remove_credentials(plan)
    return supervisor


def _start_observers(plan: RunPlan, supervisor: RunSupervisor) -> None:
    """Start the requested observers and the map page, and wait until they are ready."""
    if plan.options.view:
        supervisor.start([observer_program(plan)])
        supervisor.await_file(plan.out / "view.rrd", "observer")
        summary.print_live_view_address(plan.out)
    if plan.options.ros2:
        link = router_link(plan.options.router)
        supervisor.start([ros2_program(plan.out, link)])
        _say(f"ROS 2 topics: rmw_zenoh at {link.router}, ROS_DOMAIN_ID={link.domain}")
    if plan.options.control:
        supervisor.start([control_program(plan)])
        if supervisor.await_file(plan.out / CONTROL_ADDRESS, "control"):
            _say(f"map page: {(plan.out / CONTROL_ADDRESS).read_text()}")
        else:
            _say(f"the map page failed to start; see {plan.out / 'control.log'}")


def _say(sentence: str) -> None:
    sys.stderr.write(f"acrc: {sentence}\n")


def _report_delays(held_up: Mapping[str, StepDelays]) -> None:
    for sentence in monitor.delay_sentences(held_up):
        _say(sentence)


def _write_result(
    plan: RunPlan, swarm: MemorySwarm | RunSupervisor, started: float, bus: str, cpu_s: float
) -> RunResult:
    isolation = (
        "none" if bus == "memory" else "full" if plan.isolate and plan.debug is None else "credentials"
    )
    result, items = gather_result(
        swarm.programs,
        swarm.notes if isinstance(swarm, RunSupervisor) else {},
        step_us=plan.world.step_us,
        began_s=started,
        rosters=swarm.rosters,
        declaration=plan.world.task.declaration,
        seed=plan.world.seed,
        cpu_s=round(cpu_s, 3),
        isolation=isolation,
        bus=bus,
        out=str(plan.out),
        origin=plan.scenario.origin,
        warnings=plan.warnings,
        held_up=dict(swarm.held_up),
    )
    declaration = plan.world.task.declaration
    write_items(items, declaration.columns, plan.out / f"{declaration.table}.csv")
    (plan.out / "run.json").write_bytes(typed_json.dump(result))
    return result
