"""Commands `acrc replay`, `acrc explain` and `acrc export`."""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

from msgspec.structs import replace

from acrc_testbed.command_line import shared_options
from acrc_testbed.command_line.shared_options import (
    Json,
    Modules,
    RunFolder,
    Trust,
    answer,
    argument,
    check_absent,
    flag,
    isolation,
    option,
    permission,
)
from actors.console import create_console
from actors.installation.usage import OptionError, wrong_value

if TYPE_CHECKING:
    from acrc_testbed.recordings.record_replay import ReplayReport
    from actors.robot.behaviour.code_permit import Permit


def replay(
    out: RunFolder,
    robot: Annotated[
        str | None,
        option("NAME", "Replay only this actor: r1, r1.1 (after a restart), world or radio."),
    ] = None,
    begin: Annotated[
        float | None, option("S", "Stop in the debugger at this simulated time.", "--from", min=0.0)
    ] = None,
    end: Annotated[
        float | None, option("S", "End the replay at this simulated time.", "--to", min=0.0)
    ] = None,
    pdb: Annotated[bool, flag("Stop in the strategy's code in Python's debugger.", "--pdb")] = False,
    debugpy: Annotated[
        int | None,
        option("PORT", "Stop there for an editor that attaches to 127.0.0.1:PORT.", min=1, max=65535),
    ] = None,
    strategy: Annotated[
        str | None,
        option(
            "NAME",
            "Replay with another strategy and print its first different decision.",
            autocompletion=shared_options.strategies,
        ),
    ] = None,
    modules: Modules = None,
    trust: Trust = False,
    isolate: Annotated[bool | None, isolation("With --robot: replay in a sandbox.")] = None,
    json: Json = False,
) -> None:
    """Replay a run, or one of its robots, and compare every message.

    With --robot, one actor is replayed from its recorded inputs.
    """

    for_one_actor = {
        "--isolate": isolate, "--from": begin, "--to": end, "--pdb": pdb or None, "--debugpy": debugpy,
        "--strategy": strategy,
    }  # fmt: skip
    permit = permission(modules, trust=trust)
    if robot is None:
        check_absent("requires --robot", for_one_actor)
        from deploy.run.swarm_replay import replay_swarm

        swarm = replay_swarm(out, permit=permit)
        orders = f", with {swarm.orders} orders" if swarm.orders else ""
        cut = "" if swarm.complete else ", up to the end of the recordings"
        sentence = f"matches the recording: {swarm.messages} messages{orders}{cut}; digest {swarm.digest}"
        answer([sentence], swarm, json=json)
        return
    debugged = pdb or debugpy is not None
    if json and debugged:
        raise OptionError("--json: cannot be combined with --pdb and --debugpy")
    if pdb and debugpy is not None:
        raise OptionError("--pdb: cannot be combined with --debugpy")
    if begin is not None and not debugged:
        raise OptionError("--from: requires --pdb or --debugpy")
    if begin is not None and end is not None and begin > end:
        raise OptionError(f"--from: {begin:g}; must be at most --to, {end:g}")
    if debugged or end is not None or strategy is not None:
        if isolate:
            raise OptionError("--isolate: cannot be combined with --pdb, --debugpy, --to and --strategy")
        prints = sys.stderr if json else sys.stdout
        report = _replay_here(out, robot, begin or 0.0, end, (pdb, debugpy), strategy, permit, prints)
    else:
        from acrc_testbed.recordings import sandboxed_replay

        report = sandboxed_replay.replay(out, robot, permit=permit, isolate=isolate)
    until = "" if report.whole else " so far" if end is None else f" up to {end:g} s"
    outputs = f"matches the recording: {report.outputs} outputs{until}"
    answer([f"{report.actor}: {report.decisions or outputs}"], report, json=json)


def _replay_here(
    out: Path,
    robot: str,
    begin: float,
    end: float | None,
    debugger: tuple[bool, int | None],
    strategy: str | None,
    permit: "Permit",
    prints: TextIO,
) -> "ReplayReport":
    """Replay one actor in this process: up to `end`, with another strategy, or in a debugger."""
    from acrc_testbed.explanation.explainer import compare_decisions, processes
    from acrc_testbed.explanation.trace_replay import trace, trace_here
    from acrc_testbed.recordings import record_replay
    from acrc_testbed.recordings.record_replay import ReplayOptions, replay_actor
    from acrc_testbed.recordings.sandboxed_replay import check_trust
    from actors.robot.behaviour.code_permit import permitted_folders
    from actors.runtime.captured_output import output_to_stream
    from actors.runtime.errors import AcrcError
    from actors.runtime.isolation.sandbox import choose_isolation
    from actors.user_code import set_folders
    from cleaning.strategies import entry

    pdb, port = debugger
    if strategy or pdb or port:
        processes(out, robot)  # world and radio have no strategy
    behaviour = strategy and entry(strategy)
    if behaviour is None:
        folders = check_trust(out, robot, permit) or ()
    else:
        folders = permitted_folders(out, behaviour, (), replace(permit, typed=behaviour))
    set_folders(folders, any_content=permit.trust)
    stops = [] if port is None else [record_replay.debugpy_breakpoint(port)]
    if pdb:
        stops = [record_replay.pdb_breakpoint(own=bool(folders))]
    shown = None if stops else partial(output_to_stream, prints)  # a debugger prints itself
    replay_options = ReplayOptions(
        partial(record_replay.limit_replay, begin_s=begin, end_s=end, stops=stops), behaviour, shown
    )
    if behaviour is None:
        report = replay_actor(out, robot, replay_options)
    else:
        report = compare_decisions(
            robot,
            trace(out, robot, permit=permit, isolate=choose_isolation(None).isolate),
            trace_here(out, robot, replay_options),
        )
    if stops:
        raise AcrcError(f"--from: {begin:g} is after the end of {robot}'s recording")
    return report


def explain(
    out: RunFolder,
    who: Annotated[
        str, argument("ROBOT[@S]", "r2@157: the decision of r2 at 157 s; r2: a list of its decisions.")
    ],
    json: Json = False,
    modules: Modules = None,
    trust: Trust = False,
) -> None:
    """Explain a decision of a robot.

    Print the knowledge, the frame that brought it, and the frames lost before.

    The robot is replayed, in a sandbox if the system supports it.
    """
    from acrc_testbed.explanation import explainer as explanation
    from actors.runtime.errors import printable
    from actors.runtime.isolation.sandbox import choose_isolation, print_warning

    permit = permission(modules, trust=trust)
    request, choice = explanation.parse_request(who), choose_isolation(None)
    print_warning(choice.warning)
    explainer = explanation.Explainer(out, request.robot, permit=permit, isolate=choice.isolate)
    if request.at_s is None:
        rows = explainer.listed()
        lines = [printable(f"{row.at_s:9.3f} s  {row.words}  ({row.by})") for row in rows]
        answer(lines or [f"{request.robot} made no decision."], rows, json=json)
        return
    explanations = explainer.explain(request.at_s)
    paragraphs = ["\n".join(map(printable, explanation.sentences(one))) for one in explanations]
    answer(["\n\n".join(paragraphs)], explanations, json=json)


def export(
    out: Annotated[Path, argument("OUT", "Folder of a run; with --mcap also one collected from robots.")],
    folder: Annotated[
        Path | None,
        option(
            "PATH", "Write to this folder or file.  [default: OUT/tables; with --mcap OUT.ros2.mcap]", "--out"
        ),
    ] = None,
    mcap: Annotated[
        str | None, option("FORM", "Write an MCAP file of ROS 2 messages (ros2) for RViz and Foxglove.")
    ] = None,
    robot: Annotated[
        list[str] | None,
        option("ID", "With --mcap: write all data of this robot; repeatable.  [default: every robot]"),
    ] = None,
    json: Json = False,
) -> None:
    """Export a run as tables, or as a log of its robots.

    The tables (Parquet files) are poses, estimates, goals, frames, knowledge, exchanges, places and
    decisions. The log (MCAP) contains scans, frames, poses, plans, local cost maps, particles, the map,
    places, obstacles and radio links. Computed values require a run recorded in full.
    """
    if mcap is not None:
        _export_log(out, folder, mcap, tuple(robot or ()), json=json)
    elif robot:
        raise OptionError("--robot: requires --mcap; tables contain all robots")
    else:
        _export_tables(out, folder, json=json)


def _export_tables(out: Path, folder: Path | None, *, json: bool) -> None:
    from acrc_testbed.export import parquet_files, table_rows
    from actors.runtime import regular_file
    from actors.runtime.errors import AcrcError
    from deploy.run import out_folder

    console = create_console(stderr=True, soft_wrap=False)
    with console.status("reading"):
        explanations = table_rows.tables(out)
    with out_folder.convert_write_errors(folder or out):
        where = folder or regular_file.check_no_link(out / "tables")
        written = dict(parquet_files.write(explanations, where))
    answer(
        (f"{path}: {count} rows" for path, count in written.items()),
        [{"file": path, "rows": count} for path, count in written.items()],
        json=json,
    )
    if missing := parquet_files.missing_tables(explanations):
        raise AcrcError(f"{out}: recorded lean, so {', '.join(missing)} are missing; run with --record full")


def _export_log(out: Path, file: Path | None, name: str, robots: Sequence[str], *, json: bool) -> None:
    if name != "ros2":
        raise wrong_value("--mcap", name, "ros2, which RViz and Foxglove read")
    from acrc_testbed.export.log_export import log_run
    from deploy.run import out_folder

    path = file or out.absolute().with_name(f"{out.absolute().name}.{name}.mcap")
    console = create_console(stderr=True, soft_wrap=False)
    with out_folder.convert_write_errors(path.parent), console.status("writing"):
        report = log_run(out, path, robots)
    for note in report.notes:
        print(note, file=sys.stderr)
    size, messages, topics = path.stat().st_size, report.counts.total(), len(report.counts)
    answer(
        [f"{path}: {messages} messages of {topics} topics, {size / 1e6:.1f} MB"],
        {"file": path, "messages": messages, "topics": topics, "bytes": size},
        json=json,
    )
