"""Execution of a run: plan, hosts, preflight, processes (or one process), result."""

import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

from acrc_testbed.results import summary
from acrc_testbed.results.outcome import write_items
from acrc_testbed.results.result import RunResult, gather_result
from acrc_testbed.results.seal import remote_recordings, seal
from actors.installation.usage import wrong_value
from actors.installation.version import software_version
from actors.kernels import load_numba
from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress
from actors.orders import ItemAssignment
from actors.processes import monitor
from actors.processes.launcher import Launcher, create_launcher
from actors.processes.monitor import ResourceMonitor, Timeout
from actors.processes.robot_logs import check_names, printing_new_lines
from actors.processes.signals import Interruption, signals_as_interrupts
from actors.processes.watchdog import run_watchdog
from actors.runtime import typed_json
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import rules
from actors.runtime.isolation.mounts import code_entries, hidden_paths
from actors.runtime.isolation.sandbox import IsolationChoice, choose_isolation, print_warning
from actors.runtime.shell import MemoryBus
from actors.runtime.zenoh_bus import open_mesh
from actors.user_code import expect_hashes
from deploy.hosts.address import parse_listen
from deploy.run import progress
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
    write_run_folder,
)
from deploy.run.preflight import preflight
from deploy.run.supervisor import RunSupervisor
from deploy.scenario.resolve import Swarm, resolve
from deploy.scenario.survey import scenario_warnings
from deploy.scenario.tables import Scenario

if TYPE_CHECKING:
    from deploy.hosts.allocation import HostPool
    from deploy.hosts.run_hosts import RunHosts
    from deploy.run.memory_swarm import MemorySwarm

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
    if memory:
        load_numba()  # the run needs it, and surveys are faster with it
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
        from deploy.run.dry_run import preflight_in_process  # noqa: PLC0415

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
    from deploy.run.memory_swarm import MemorySwarm  # noqa: PLC0415  # the world's and radio's modules

    started = time.time()
    write_run_folder(plan)
    swarm = MemorySwarm(plan, bus or MemoryBus(), on_progress)
    try:
        with signals_as_interrupts():
            swarm.run()
    except Interruption:
        _report_delays(swarm.stalls)
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
        _report_delays(supervisor.stalls)
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


def _report_delays(stalls: monitor.StallDetector) -> None:
    for sentence in monitor.delay_sentences(stalls.held_up):
        _say(sentence)


def _write_result(
    plan: RunPlan, swarm: "MemorySwarm | RunSupervisor", started: float, bus: str, cpu_s: float
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
        held_up=dict(swarm.stalls.held_up),
    )
    declaration = plan.world.task.declaration
    write_items(items, declaration.columns, plan.out / f"{declaration.table}.csv")
    (plan.out / "run.json").write_bytes(typed_json.dump(result))
    return result
