"""A whole run: from a scenario to processes over the mesh or cores in memory, and to the result."""

import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from actors.installation.usage import wrong_value
from actors.installation.version import software
from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress
from actors.orders import Give
from actors.processes import silence
from actors.processes.launch import Launcher, Program, launcher
from actors.processes.resource_watch import ResourceWatch
from actors.processes.robot_logs import check_names, shown
from actors.processes.signals import Interrupted, signals_as_interrupts
from actors.processes.silence import HoldUp, Timeout
from actors.processes.warden import warded
from actors.robot.behaviour.modules import expect
from actors.runtime.access import rules
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.bus.zenoh_bus import open_mesh
from actors.runtime.core import at
from actors.runtime.isolation.sandbox import IsolationChoice, choose, warn
from deploy.run import progress
from deploy.run.hosting import allocated_hosts, hosts_of
from deploy.run.memory_swarm import MemorySwarm
from deploy.run.options import RunOptions
from deploy.run.out_folder import check_new
from deploy.run.plan import (
    CONTROL_ADDRESS,
    Debugged,
    RunPlan,
    control_program,
    in_common,
    issue_credentials,
    lay_out,
    observer_program,
    radio_program,
    remove_credentials,
    robot_program,
    router_of,
    world_program,
)
from deploy.run.preflight import preflight, preflight_here
from deploy.run.scenario_copy import copied_scenario
from deploy.run.supervisor import Supervisor
from deploy.scenario.resolve import ResolvedScenario, resolve
from deploy.scenario.tables import Scenario
from deploy.scenario.warnings import scenario_warnings
from observation.results import summary
from observation.results.hosts_file import elsewhere
from observation.results.place_table import write_table
from observation.results.result import Circumstances, RunResult, gather
from observation.results.seal import seal

if TYPE_CHECKING:
    from deploy.hosts.run_hosts import Recruits, RunHosts

OPERATOR: Final = "operator"
"""Name of the parent process on the mesh."""
OnProgress = Callable[[Progress], None]


def run(scenario: Scenario, options: RunOptions, launched: Launcher | None = None) -> RunResult:
    """Run the scenario; AcrcError if it cannot be run to its end.

    `launched`: what starts the processes, if that has begun already. The result also stands in run.json, and
    what became of every place in places.csv; the folder is sealed.
    """
    with allocated_hosts(options) as recruits:
        return _run(scenario, options, launched, recruits)


def _run(
    scenario: Scenario, options: RunOptions, launched: Launcher | None, recruits: "Recruits | None"
) -> RunResult:
    prepared = plan(scenario, options, None if recruits is None else recruits.isolation_fault)
    for sentence in (prepared.warning, *(() if options.json else prepared.warnings)):
        warn(sentence)
    places = sum(len(robot.places) for robot in prepared.world.robots)
    given = (timed.order for timed in prepared.world.events)
    places += sum(len(order.places) for order in given if isinstance(order, Give))
    quiet = options.json or prepared.debug is not None  # the terminal is the debugger's
    check_names(options.log, [robot.id for robot in prepared.world.robots], "--log")
    with (
        progress.shown(prepared.world.duration_us, places, quiet=quiet) as follow,
        shown(options.out, options.log) as look,
    ):

        def on_progress(message: Progress) -> None:
            follow(message)
            look()

        if options.bus == "memory":
            result = run_in_memory(prepared, on_progress)
        else:
            result = run_processes(prepared, options.spawn, on_progress, launched, recruits)
    seal(options.out, {name: one.sha256 for name, one in elsewhere(options.out).items()})
    return result


def plan(scenario: Scenario, options: RunOptions, elsewhere: str | None = None) -> RunPlan:
    """The run that the scenario and the options mean, with everything drawn.

    `elsewhere`: why robots cannot be isolated on other computers of the run; None if they can.
    For a run in memory the strategy's code runs once in this process; what it raises, but for AcrcError, is
    its own.
    """
    memory = options.bus == "memory"
    choice = IsolationChoice(False) if memory else choose(options.isolate, elsewhere=elsewhere)
    settled = resolve(scenario)
    _check_followed(settled, options)
    planned = RunPlan(
        options=options,
        world=settled.world,
        radio=settled.radio,
        behaviour=settled.behaviour,
        adaptation=settled.adaptation,
        stack=settled.stack,
        scenario=copied_scenario(settled, options),
        commit=software(),
        isolate=choice.isolate,
        warning=choice.warning,
        warnings=scenario_warnings(settled),
        timeout=Timeout(step_s=options.timeout_s if options.debug is None else math.inf),
        debug=_debugged(settled, options),
    )
    if options.bus == "memory":
        expect(options.recorded)
        with warded(planned.timeout.step_s) if planned.own_code else nullcontext():
            preflight_here(settled, options.modules)
    return planned


def _check_followed(settled: ResolvedScenario, options: RunOptions) -> None:
    robots = [robot.id for robot in settled.world.robots]
    for robot in options.followed:
        if robot not in robots:
            raise wrong_value("--robot", robot, f"one of {', '.join(robots)}")


def _debugged(settled: ResolvedScenario, options: RunOptions) -> Debugged | None:
    if options.debug is None:
        return None
    robots = [robot.id for robot in settled.world.robots]
    if options.debug not in robots:
        raise wrong_value("--debug", options.debug, f"one of {', '.join(robots)}")
    return Debugged(options.debug, "" if options.bus == "memory" else os.ttyname(0))


def run_in_memory(plan: RunPlan, on_progress: OnProgress, bus: MemoryBus | None = None) -> RunResult:
    """Run all actors in this process."""
    began = time.time()
    lay_out(plan)
    swarm = MemorySwarm(plan, bus or MemoryBus(), on_progress)
    try:
        with signals_as_interrupts():
            swarm.run()
    except Interrupted:
        _tell(swarm.held_up)
        raise
    about = _circumstances(plan, began, "memory", swarm.rosters, time.process_time())
    about = replace(about, held_up=swarm.held_up)
    return _finish(plan, swarm.programs, about)


def run_processes(
    plan: RunPlan,
    spawn: str,
    on_progress: OnProgress,
    launched: Launcher | None = None,
    recruits: "Recruits | None" = None,
) -> RunResult:
    """Run every actor as a process of its own; none is left when this returns or raises.

    `launched`: what starts them, if that has begun already; else it begins here. `recruits`: are to have the
    robots.
    """
    began = time.time()
    check_new(plan.out)
    with signals_as_interrupts(), nullcontext(launched) if launched else launcher(spawn) as starting:
        preflight(plan, starting)
        lay_out(plan)
        with hosts_of(plan, recruits) as away:
            supervisor = _supervise(plan, starting, on_progress, away)
    cpu_s = supervisor.cpu_s + time.process_time()
    about = _circumstances(plan, began, "zenoh", supervisor.rosters, cpu_s)
    about = replace(about, held_up=supervisor.held_up, notes=supervisor.notes)
    return _finish(plan, supervisor.programs, about)


def _supervise(
    plan: RunPlan, launched: Launcher, on_progress: OnProgress, away: "RunHosts | None" = None
) -> Supervisor:
    """Start the processes, and stay until they have ended."""
    launched.withdraw(router_of(plan))
    issued = issue_credentials(plan, None if away is None else away.gate)
    robots = {robot.id: robot for robot in plan.world.robots}
    starting = launched if away is None else away.launcher(launched, _say)
    supervisor = Supervisor(
        starting,
        lambda order, step: robot_program(plan, robots[order.robot], order, step),
        on_progress,
        plan.timeout,
        ResourceWatch(plan.options.limits),
        _say,
    )
    try:
        supervisor.start([world_program(plan), radio_program(plan)])
        for words in in_common(plan, Path()) if away is None else ():
            launched.share("actors.robot.program", words, plan.out)
        supervisor.await_file(issued.sockets[OPERATOR], "world")
        config = rules.client_config(issued.files[OPERATOR], issued.endpoint(OPERATOR))
        with open_mesh(config, (at(PROGRESS), at(ROSTER)), between=supervisor.look) as bus:
            if away is not None:
                away.join(supervisor.check, starting.wait)
                away.write()
                _say(away.sentence)
            if plan.options.view:
                supervisor.start([observer_program(plan)])
                supervisor.await_file(plan.out / "view.rrd", "observer")
                summary.print_viewer(plan.out)
            if plan.options.control:
                supervisor.start([control_program(plan)])
                if supervisor.await_file(plan.out / CONTROL_ADDRESS, "control"):
                    _say(f"the map page is {(plan.out / CONTROL_ADDRESS).read_text()}")
                else:
                    _say(f"the map page is not served; {plan.out / 'control.log'} says why")
            first = (ProcessOrder(robot, 0) for robot in robots)
            supervisor.start([robot_program(plan, robots[order.robot], order, 0) for order in first])
            supervisor.watch(bus)
            if away is not None and (loads := away.loads):
                _say(loads)
    except Interrupted:
        _tell(supervisor.held_up)
        raise
    finally:
        supervisor.end_all()
        if away is not None:
            away.dismiss(starting.wait)
            away.write()
            if kept := away.kept:
                _say(kept)
        remove_credentials(plan)
    return supervisor


def _say(sentence: str) -> None:
    sys.stderr.write(f"acrc: {sentence}\n")


def _tell(held_up: Mapping[str, HoldUp]) -> None:
    for sentence in silence.sentences(held_up):
        _say(sentence)


def _finish(plan: RunPlan, programs: Sequence[Program], about: Circumstances) -> RunResult:
    result, places = gather(programs, about)
    write_table(places, plan.out / "places.csv")
    (plan.out / "run.json").write_bytes(msgspec.json.format(msgspec.json.encode(result)) + b"\n")
    return result


def _circumstances(plan: RunPlan, began: float, bus: str, rosters: int, cpu_s: float) -> Circumstances:
    isolation_kind = (
        "none" if bus == "memory" else "full" if plan.isolate and plan.debug is None else "credentials"
    )
    return Circumstances(
        out=plan.out,
        robots=[robot.id for robot in plan.world.robots],
        seed=plan.world.seed,
        step_us=plan.world.step_us,
        isolation=isolation_kind,
        bus=bus,
        origin=plan.scenario.origin,
        warnings=plan.warnings,
        began_s=began,
        cpu_s=cpu_s,
        parent_received=rosters,
    )
