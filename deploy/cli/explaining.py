"""`acrc explain`: why a robot decided something."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from deploy.cli.options import Json


def explain(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A run's folder.")],
    who: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT[@S]", help="r2@157: what r2 decided at 157 s; r2 alone lists all of its decisions."
        ),
    ],
    json: Json = False,
    trust: Annotated[
        bool, typer.Option("--trust", help="Run the code that the recording names, whoever wrote it.")
    ] = False,
) -> None:
    """Say why a robot decided as it did: the knowledge, the frame that brought it, and what was lost before.

    The robot and the radio are executed again from their recordings.
    """
    from deploy.explanation import explain as explanation

    console = Console(soft_wrap=True, highlight=False, markup=False)
    asked = explanation.wish(who)
    if asked.at_s is None:
        rows = explanation.listed(out, asked.robot, trust=trust)
        if json:
            print(explanation.as_json(rows))
            return
        for row in rows:
            console.print(f"{row.at_s:9.3f} s  {row.words}  ({row.by})")
        if not rows:
            console.print(f"{asked.robot} never decides anything.")
        return
    found = explanation.explain(out, asked, trust=trust)
    if json:
        print(explanation.as_json(found))
        return
    for number, one in enumerate(found):
        for line in ([""] if number else []) + list(explanation.sentences(one)):
            console.print(line)
