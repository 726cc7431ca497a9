"""`acrc log`: what the code of robots has printed."""

import time
from pathlib import Path
from typing import Annotated

import typer

_POLL_S = 0.1


def log(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder, also while it goes on.")],
    names: Annotated[list[str] | None, typer.Argument(metavar="[ROBOT…]", help="[default: all]")] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Follow what is printed, to the end of the run.")
    ] = False,
) -> None:
    """Show what the strategy of robots has printed or logged, with simulated time and step."""
    from actors.processes.robot_logs import EVERYBODY, check_names, robots, shown
    from observation.recordings.topics import has_ended

    wanted = names or [EVERYBODY]
    check_names(wanted, robots(out), str(out))
    with shown(out, wanted, lambda line: print(line, flush=follow)) as look:
        while follow and not has_ended(out):
            look()
            time.sleep(_POLL_S)
