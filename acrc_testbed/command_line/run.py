"""`acrc run` and `acrc order`: a run is started, and told what to do while it goes on."""

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Final, Literal, cast

from acrc_testbed.command_line import options
from acrc_testbed.command_line.options import (
    Json,
    Modules,
    Record,
    Robots,
    ScenarioFile,
    Seed,
    Setting,
    Trust,
    answer,
    argument,
    flag,
    isolation,
    option,
)
from actors.console import screen
from actors.installation.usage import OptionError, typed
from actors.runtime.errors import AcrcError

_BASELINES: Final = ("none", "none-original", "none-giving-up")
"""Strategies without adaptation."""


def run(
    scenario: ScenarioFile = None,
    robots: Robots = None,
    seed: Seed = None,
    key: Annotated[
        str | None, option("HEX", "Secret part of the random seed, which no strategy can guess.")
    ] = None,
    duration: Annotated[str | None, option("S", "Simulated seconds.")] = None,
    step: Annotated[str | None, option("MS", "Length of a step, 10 to 100 ms.")] = None,
    strategy: Annotated[
        str | None,
        option(
            "NAME",
            "Adaptation strategy: a name from `acrc list strategies`, or module:function. "
            "Drops the scenario's settings of another strategy.",
            autocompletion=options.strategies,
        ),
    ] = None,
    navigation: Annotated[
        str | None,
        option(
            "PRESET",
            "Preset of navigation: robust, or chapter (the original's; robots may get stuck).",
            autocompletion=options.navigation,
        ),
    ] = None,
    setting: Setting = None,
    record: Record = "full",
    speed: Annotated[
        str | None, option("X", "Simulated seconds per second, or max.  [default: max; with --control: 1]")
    ] = None,
    bus: Annotated[
        str,
        option(
            "zenoh|memory",
            "Run each robot as a process (zenoh), or all in one process (memory).",
            autocompletion=lambda: ["zenoh", "memory"],
        ),
    ] = "zenoh",
    spawn: Annotated[
        str,
        option("forkserver|exec", "How to start processes.", autocompletion=lambda: ["forkserver", "exec"]),
    ] = "forkserver",
    isolate: Annotated[
        bool | None, isolation("Run each robot in a sandbox that leaves it its own senses and radio only.")
    ] = None,
    out: Annotated[
        Path | None, option("DIR", "New folder for the recordings and the result.  [default: in runs/]")
    ] = None,
    log: Annotated[
        list[str] | None, option("NAME", "Show what this robot's strategy prints; * for all. Repeatable.")
    ] = None,
    view: Annotated[bool, flag("Show the run while it goes on.", "--view")] = False,
    robot: Annotated[
        list[str] | None,
        option("ID", "With --view: show what this robot perceives; repeatable.  [default: the first eight]"),
    ] = None,
    debug: Annotated[
        str | None,
        option(
            "ROBOT",
            "breakpoint() in this robot's strategy stops here, and with it the run; nothing times out.",
        ),
    ] = None,
    control: Annotated[
        bool, flag("Serve a map page on this computer: drag robots, add walls, pause.", "--control")
    ] = False,
    hardware: Annotated[
        bool,
        flag(
            "Run the processes of real robots, with emulated devices, in wall time.", "--hardware-in-the-loop"
        ),
    ] = False,
    board: Annotated[
        list[str] | None,
        option(
            "ID",
            "With --hardware-in-the-loop: give this robot a board, all others a simulated transceiver; "
            "repeatable.  [default: all]",
        ),
    ] = None,
    on: Annotated[
        str | None,
        option(
            "ADDRESS", "Run the robots on the computers of a Dask cluster: tls://HOST:PORT.  [default: here]"
        ),
    ] = None,
    listen: Annotated[
        str | None,
        option(
            "HOST[:PORT]", "With --on: address and port here that those computers connect to.  [default: any]"
        ),
    ] = None,
    leave: Annotated[
        bool,
        flag("With --on: leave recordings there, until `acrc cluster fetch`.  [default: bring]", "--leave"),
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
        option("S", "End the run if one process keeps all others waiting for longer.", min=1, max=86400),
    ] = 30.0,
    json: Json = False,
    check: Annotated[
        bool,
        flag("Replay every robot afterwards, and fail if one depends on more than its inputs.", "--check"),
    ] = False,
) -> None:
    """Run a swarm and say what came of it. Options replace what the scenario says."""
    from actors.robot.behaviour import code_permit

    permit = code_permit.permit_of(modules, trust=trust)
    from deploy.hosts.address import plain
    from deploy.run.options import RunOptions, folder_name
    from deploy.run.start import claimed, prepare_run, start_run
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
        out or Path("runs", folder_name(file)),
        record=cast(Literal["lean", "full"], record),  # checked with the other options
        speed=speed or ("1" if control else "max"),
        bus=bus,
        spawn=spawn,
        isolate=isolate,
        scenario=file.name,
        hidden=(scenario.absolute(),) if scenario else (),
        view=view,
        debug=debug,
        control=control,
        hardware=hardware,
        boards=tuple(board or ()),
        on=plain(on) if on else "",
        listen=listen or "",
        leave=leave,
        timeout_s=timeout,
        json=json,
        check=check,
        log=tuple(log or ()),
        followed=tuple(robot or ()),
    )
    prepared = prepare_run(file, overrides, options, permit, limit or ())
    by = None
    if hardware:
        from deploy.fleet import hardware_in_the_loop

        by = hardware_in_the_loop.run
    if out is None:
        prepared = claimed(prepared)
    result = start_run(prepared, quiet=json, by=by)
    from acrc_testbed.results import summary
    from acrc_testbed.results.result import demand_all

    summary.print_result(result, json=json)
    if hardware:
        return
    chosen, options = prepared
    if not json:
        adapted = chosen.run.strategy not in _BASELINES
        summary.print_next(options.out, [*_baseline(sys.argv[1:], out)] if adapted else ())
    if view:
        summary.print_view(options.out)
    demand_all(result.undelivered, result.not_delivered)
    if check:
        _check_again(options.out, options.modules)


def _baseline(words: Iterable[str], out: Path | None) -> Iterator[str]:
    """Yield the words of the same run without adaptation, in a folder beside `out` if that was given."""
    rest = iter(words)
    for word in rest:
        found = (word, next(rest)) if word in {"--set", "--strategy", "--out"} else (word,)
        if not re.match(r"--(strategy|out|set[ =]strategy\.)", " ".join(found)):
            yield from found
    yield from ("--strategy", "none")
    if out is not None:
        yield from ("--out", f"{out}-none")


def _check_again(out: Path, modules: tuple[Path, ...]) -> None:
    """Execute a run's actors again; what comes out stands on standard error, beside the result."""
    from acrc_testbed.recordings.record_replay import recheck

    again = recheck(out, modules)
    screen(stderr=True).print(f"checked: {again.actors} actors replayed, all {again.outputs} messages equal")


def branch(
    place: Annotated[str, argument("RUN@S", "A recorded run's folder, and an instant in simulated seconds.")],
    strategy: Annotated[
        str | None,
        option("NAME", "Let robots follow this strategy from then on.", autocompletion=options.strategies),
    ] = None,
    setting: Annotated[
        list[str] | None,
        option("KEY=VALUE", "Set a setting of --strategy: strategy.N=3. Repeatable.", "--set"),
    ] = None,
    event: Annotated[
        list[str] | None, option("ORDER", "Give an order: 'kill r2 at 130'. Repeatable.")
    ] = None,
    out: Annotated[Path | None, option("DIR", "New folder for the branch.  [default: in runs/]")] = None,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Continue a recorded run with a change and say what differs.

    Without a change the branch equals the run.
    """
    from actors.robot.behaviour.code_permit import permit_of
    from deploy.run.branching import continue_run

    permit = permit_of(modules, trust=trust)
    continue_run(place, strategy, setting or (), event or (), out, permit=permit, json=json)


def order(
    out: Annotated[Path, argument("OUT", "The folder of a run in progress.")],
    verb: Annotated[
        str, argument("VERB", "kill, freeze, move, pause, stop, …", autocompletion=options.orders)
    ],
    words: Annotated[list[str] | None, argument("WORDS", "Arguments of the verb.")] = None,
    json: Json = False,
) -> None:
    """Give an order to a run in progress.

    Example: acrc order runs/mine kill r2. It prints what became of the order; the exit code is 1 if the run
    refused it.
    """
    from deploy.run import orders, out_folder

    if str(out) in orders.VERBS and verb not in orders.VERBS:
        folder = out_folder.newest(Path("runs")) or "runs/NAME"
        raise OptionError(f"OUT: missing; example: {typed('order', folder, out, verb)}")
    given = " ".join([verb, *(words or [])])
    refusal = orders.send(out, orders.parse(verb, words or []))
    if refusal:
        raise AcrcError(f"the run refused the order {given!r} {refusal}")
    answer([f"acrc: the run has carried out: {given}"], {"order": given}, json=json)
