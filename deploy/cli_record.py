"""What can be done with the recordings of a run, on the command line."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
_Out = Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder.")]


@app.command()
def check(out: _Out) -> None:
    """Compute the digest again from the recordings, and compare it with the result."""
    from deploy import record

    report = record.check(out)
    console = Console(soft_wrap=True, highlight=False)
    console.print(f"digest {report.digest} over {report.messages} messages")
    if report.unreceived:
        console.print(f"{report.unreceived} large messages are known by their hash only: nobody took them in")
    if not report.complete:
        console.print("the run did not end as planned: this is the digest of what was recorded until then")


@app.command()
def replay(
    out: _Out,
    actor: Annotated[str, typer.Argument(metavar="ACTOR", help="world, radio, r1, or r1.1 once restarted.")],
) -> None:
    """Execute one actor again from what it received, and compare everything it sends."""
    from deploy import record

    report = record.replay_actor(out, actor)
    Console(soft_wrap=True, highlight=False).print(
        f"{report.actor}: {report.outputs} messages sent again, all equal to the recorded ones"
    )
