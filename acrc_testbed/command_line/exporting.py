"""`acrc export`: a run as tables, or as a log of its robots."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acrc_testbed.command_line.options import Json, Modules, Trust, answer
from actors.console import screen
from actors.installation.usage import OptionError, wrong_value

if TYPE_CHECKING:
    from actors.robot.behaviour.foreign import Permit


def export(
    out: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="A run's folder; with --mcap also one collected from robots."),
    ],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="PATH",
            help="Output folder or file.  [default: OUT/tables; with --mcap OUT.ros2.mcap]",
        ),
    ] = None,
    mcap: Annotated[
        str | None,
        typer.Option(
            metavar="FORM", help="Write an MCAP file of ROS 2 messages (ros2), for RViz and Foxglove."
        ),
    ] = None,
    robot: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="With --mcap: write all of this robot; repeatable.  [default: of every one]",
        ),
    ] = None,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Write a run as tables, or as a log of its robots.

    The tables (Parquet files) are poses, estimates, goals, frames, knowledge, exchanges, places and
    decisions. The log (MCAP) has scans, frames, poses, plans, local cost maps, particles, the map, places,
    obstacles and radio links.

    It replays radio and robots to compute what was not recorded, robots in a sandbox where the machine has
    one.
    """
    from actors.robot.behaviour.foreign import permit_of

    permit = permit_of(modules, trust=trust)
    if mcap is not None:
        _export_log(out, folder, mcap, tuple(robot or ()), permit, json=json)
        return
    if robot:
        raise OptionError("--robot: requires --mcap; tables are of all robots")
    _export_tables(out, folder, permit, json=json)


def _export_tables(out: Path, folder: Path | None, permit: "Permit", *, json: bool) -> None:
    from acrc_testbed.replay.run_recordings import recordings
    from acrc_testbed.replay.sandboxed import check_trust
    from actors.runtime import regular_file

    for actor in recordings(out):
        check_trust(out, actor, permit)
    from acrc_testbed.export import parquet_files, rows
    from actors.runtime.isolation.sandbox import choose, warn
    from deploy.run import out_folder

    choice = choose(None)
    warn(choice.warning)
    console = screen(stderr=True, soft_wrap=False)
    with console.status("reading") as status:
        found = rows.tables(
            out,
            lambda actor: status.update(f"replaying {actor}"),
            permit=permit,
            isolate=choice.isolate,
        )
    with out_folder.writing(folder or out):
        where = folder or regular_file.no_link(out / "tables")
        written = dict(parquet_files.write(found, where))
    said = [f"{path}: {count} rows" for path, count in written.items()]
    answer(said, [{"file": path, "rows": count} for path, count in written.items()], json=json)


def _export_log(
    out: Path, file: Path | None, name: str, robots: Sequence[str], permit: "Permit", *, json: bool
) -> None:
    if name != "ros2":
        raise wrong_value("--mcap", name, "ros2, which RViz and Foxglove read")
    from acrc_testbed.robot_logs.logging_run import log_run
    from actors.runtime.isolation.sandbox import choose, warn
    from deploy.run import out_folder

    path = file or out.absolute().with_name(f"{out.absolute().name}.{name}.mcap")
    choice = choose(None)
    warn(choice.warning)
    console = screen(stderr=True, soft_wrap=False)
    with out_folder.writing(path.parent), console.status("reading") as status:
        report = log_run(
            out,
            path,
            robots,
            lambda actor: status.update(f"replaying {actor}" if actor else "writing"),
            permit=permit,
            isolate=choice.isolate,
        )
    for note in report.notes:
        print(note, file=sys.stderr)
    size, messages, topics = path.stat().st_size, report.counts.total(), len(report.counts)
    said = f"{path}: {messages} messages of {topics} topics, {size / 1e6:.1f} MB"
    answer([said], {"file": path, "messages": messages, "topics": topics, "bytes": size}, json=json)
