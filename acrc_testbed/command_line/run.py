"""Commands `acrc run`, `acrc branch` and `acrc order`."""

import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Final, Literal, cast

from acrc_testbed.command_line import shared_options
from acrc_testbed.command_line.shared_options import (
    Json,
    Modules,
    Record,
    Robots,
    Ros2,
    Router,
    ScenarioFile,
    Seed,
    Setting,
    Trust,
    answer,
    argument,
    flag,
    isolation,
    option,
    permission,
)
from actors.console import create_console
from actors.installation.usage import OptionError, command_line
from actors.runtime.errors import AcrcError

_BASELINES: Final = ("none", "none-original", "none-giving-up")
"""Strategies without adaptation."""


def run(
    scenario: ScenarioFile = None,
    robots: Robots = None,
    seed: Seed = None,
    key: Annotated[
        str | None, option("HEX", "Set the secret part of the random seed, hidden from strategies.")
    ] = None,
    duration: Annotated[str | None, option("S", "Simulate at most this many seconds.")] = None,
    step: Annotated[str | None, option("MS", "Set the length of a step, 10 to 100 ms.")] = None,
    strategy: Annotated[
        str | None,
        option(
            "NAME",
            "Use this adaptation strategy: a name from `acrc list strategies`, or module:function. "
            "Ignores the scenario's settings of another strategy.",
            autocompletion=shared_options.strategies,
        ),
    ] = None,
    navigation: Annotated[
        str | None,
        option(
            "PRESET",
            "Use this navigation preset: robust, or chapter (the original; robots may get stuck).",
            autocompletion=shared_options.navigation,
        ),
    ] = None,
    setting: Setting = None,
    record: Record = "full",
    speed: Annotated[
        str | None,
        option("X", "Limit simulated seconds per second; max: no limit.  [default: max; with --control: 1]"),
    ] = None,
    bus: Annotated[
        str,
        option(
            "zenoh|memory",
            "Run each robot in its own process (zenoh), or all in one process (memory).",
            autocompletion=lambda: ["zenoh", "memory"],
        ),
    ] = "zenoh",
    spawn: Annotated[
        str,
        option(
            "forkserver|exec",
            "Start processes by this method.",
            autocompletion=lambda: ["forkserver", "exec"],
        ),
    ] = "forkserver",
    isolate: Annotated[
        bool | None, isolation("Run each robot in a sandbox with access to its sensors and radio only.")
    ] = None,
    out: Annotated[
        Path | None, option("DIR", "Write recordings and result to this new folder.  [default: in runs/]")
    ] = None,
    log: Annotated[
        list[str] | None, option("NAME", "Show the output of this robot's strategy; * for all. Repeatable.")
    ] = None,
    view: Annotated[bool, flag("Show the run in the viewer.", "--view")] = False,
    robot: Annotated[
        list[str] | None,
        option("ID", "With --view: show this robot's perception; repeatable.  [default: the first eight]"),
    ] = None,
    ros2: Ros2 = False,
    router: Router = None,
    debug: Annotated[
        str | None,
        option(
            "ROBOT",
            "Stop at breakpoint() in this robot's strategy; pauses the run and disables timeouts.",
        ),
    ] = None,
    control: Annotated[
        bool, flag("Serve a map page on this computer to drag robots, add walls, pause.", "--control")
    ] = False,
    hardware: Annotated[
        bool,
        flag(
            "Run the processes of real robots with emulated devices, in wall time.", "--hardware-in-the-loop"
        ),
    ] = False,
    board: Annotated[
        list[str] | None,
        option(
            "ID",
            "With --hardware-in-the-loop: emulate the radio board of this robot, simulate the transceivers "
            "of others; repeatable.  [default: all]",
        ),
    ] = None,
    on: Annotated[
        str | None,
        option("ADDRESS", "Run the robots on a Dask cluster: tls://HOST:PORT.  [default: on this computer]"),
    ] = None,
    listen: Annotated[
        str | None,
        option(
            "HOST[:PORT]", "With --on: accept connections of the cluster at this address.  [default: any]"
        ),
    ] = None,
    leave: Annotated[
        bool,
        flag("With --on: leave recordings on the hosts until `acrc cluster fetch`.", "--leave"),
    ] = False,
    modules: Modules = None,
    trust: Trust = False,
    limit: Annotated[
        list[str] | None,
        option(
            "NAME=N",
            "Limit each robot's process: memory_mb, open_files, file_mb, disk_mb, disk_files, "
            "processes. Repeatable.",
        ),
    ] = None,
    timeout: Annotated[
        float,
        option("S", "Abort the run if one process delays the others for longer.", min=1, max=86400),
    ] = 30.0,
    json: Json = False,
    check: Annotated[
        bool,
        flag("Replay every robot after the run; fail if one depends on more than its inputs.", "--check"),
    ] = False,
) -> None:
    """Run a swarm and print the result. Options override the scenario."""
    with ExitStack() as stack:
        early = None
        if bus == "zenoh" and not hardware:  # the server imports the actors' modules from now on
            from actors.processes.launcher import create_launcher

            early = stack.enter_context(create_launcher(spawn))
        permit = permission(modules, trust=trust)
        from actors.processes.kernel_compilation import are_compiled
        from deploy.hosts.address import dask_address
        from deploy.run.options import RunOptions, run_folder_name
        from deploy.run.start import prepare_run, start_run, with_claimed_folder
        from deploy.scenario.scenario_file import DEFAULT_SCENARIO, Overrides, parse_settings

        overrides = Overrides(
            robots=robots,
            seed=seed,
            key=key,
            duration=duration,
            step=step,
            strategy=strategy,
            navigation=navigation,
            settings=parse_settings(setting or ()),
        )
        file = scenario or DEFAULT_SCENARIO
        options = RunOptions(
            out or Path("runs", run_folder_name(file, strategy)),
            record=cast(Literal["lean", "full"], record),  # checked with the other options
            speed=speed or ("1" if control else "max"),
            bus=bus,
            spawn=spawn,
            isolate=isolate,
            scenario=file.name,
            hidden=(scenario.absolute(),) if scenario else (),
            view=view,
            ros2=ros2,
            router=router or "",
            debug=debug,
            control=control,
            hardware=hardware,
            boards=tuple(board or ()),
            on=dask_address(on) if on else "",
            listen=listen or "",
            leave=leave,
            timeout_s=timeout,
            json=json,
            check=check,
            log=tuple(log or ()),
            followed=tuple(robot or ()),
        )
        if early is not None and not are_compiled():
            stack.close()  # it would compile everything, too
            early = None
        prepared = prepare_run(file, overrides, options, permit, limit or ())
        runner = None
        if hardware:
            from deploy.fleet import hardware_in_the_loop

            runner = hardware_in_the_loop.run
        if out is None:
            prepared = with_claimed_folder(prepared)
        result = start_run(prepared, quiet=json, by=runner, launcher=early)
    from acrc_testbed.results import summary
    from acrc_testbed.results.result import require_delivery

    summary.print_result(result, json=json)
    if hardware:
        return
    checked, options = prepared
    if not json:
        naive = result.declaration.baseline
        adapted = naive and checked.run.strategy not in {naive, *_BASELINES}
        baseline = [*_baseline_arguments(sys.argv[1:], out, naive)] if adapted else ()
        summary.print_next_commands(options.out, baseline, options.modules)
    if view or ros2:
        summary.print_observer_messages(options.out)
    require_delivery(result.undelivered, result.not_delivered)
    if check:
        from acrc_testbed.recordings.record_replay import recheck

        report = recheck(options.out, options.modules)
        create_console(stderr=True).print(
            f"checked: {report.actors} actors replayed, all {report.outputs} messages equal"
        )


def _baseline_arguments(arguments: Iterable[str], out: Path | None, naive: str) -> Iterator[str]:
    """Yield the arguments of the same run with the strategy `naive`, in `out`-none if `out` was given."""
    remaining = iter(arguments)
    for word in remaining:
        group = (word, next(remaining)) if word in {"--set", "--strategy", "--out"} else (word,)
        if not re.match(r"--(strategy|out|set[ =]strategy\.)", " ".join(group)):
            yield from group
    yield from ("--strategy", naive)
    if out is not None:
        yield from ("--out", f"{out}-none")


def branch(
    place: Annotated[str, argument("RUN@S", "Folder of a recorded run, and simulated time of the branch.")],
    strategy: Annotated[
        str | None,
        option("NAME", "Use this strategy from that time on.", autocompletion=shared_options.strategies),
    ] = None,
    setting: Annotated[
        list[str] | None,
        option("KEY=VALUE", "Change a setting of --strategy: strategy.N=3. Repeatable.", "--set"),
    ] = None,
    event: Annotated[list[str] | None, option("ORDER", "Add an order: 'kill r2 at 130'. Repeatable.")] = None,
    out: Annotated[
        Path | None, option("DIR", "Write the branch to this new folder.  [default: in runs/]")
    ] = None,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Continue a recorded run with a change and print the differences.

    Without a change the branch equals the run.
    """
    from deploy.run.branching import continue_run

    permit = permission(modules, trust=trust)
    continue_run(place, strategy, setting or (), event or (), out, permit=permit, json=json)


def order(
    out: Annotated[Path, argument("OUT", "Folder of a run in progress.")],
    verb: Annotated[
        str,
        argument("VERB", "Order: kill, freeze, move, pause, stop, …", autocompletion=shared_options.orders),
    ],
    words: Annotated[list[str] | None, argument("WORDS", "Arguments of the verb.")] = None,
    json: Json = False,
) -> None:
    """Send an order to a run in progress.

    Example: acrc order runs/mine kill r2. The exit code is 1 if the run refuses the order.
    """
    from deploy.run import order_bus, out_folder

    if str(out) in order_bus.VERBS and verb not in order_bus.VERBS:
        folder = out_folder.newest_run(Path("runs")) or "runs/NAME"
        raise OptionError(f"OUT: missing; example: {command_line('order', folder, out, verb)}")
    sent = " ".join([verb, *(words or [])])
    refusal = order_bus.send(out, order_bus.parse(verb, words or []))
    if refusal:
        raise AcrcError(f"the run refused the order {sent!r} {refusal}")
    answer([f"acrc: order executed: {sent}"], {"order": sent}, json=json)
