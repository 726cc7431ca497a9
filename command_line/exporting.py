"""`acrc export`: a run as tables."""

from pathlib import Path
from typing import Annotated

import typer

from actors.console import screen
from command_line.options import Modules, Trust


def export(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder.")],
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where to.  [default: OUT/tables]")
    ] = None,
    modules: Modules = None,
    trust: Trust = False,
) -> None:
    """Write a run as tables (Parquet files).

    The tables are poses, estimates, goals, frames, knowledge, exchanges, places and decisions.

    It replays radio and robots to compute what was not recorded, robots in a sandbox where the machine has
    one.
    """
    from actors.robot.behaviour.foreign import permit_of
    from actors.runtime import regular_file
    from observation.replay.run_recordings import recordings
    from observation.replay.trust import check_trust

    permit = permit_of(modules, trust=trust)
    for actor in recordings(out):
        check_trust(out, actor, permit)
    from actors.runtime.isolation.isolating import choose, warn
    from deploy.run import out_folder
    from observation.export import parquet_files, rows

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
        for path, count in parquet_files.write(found, where):
            print(f"{path}: {count} rows")
