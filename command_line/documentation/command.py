"""The command of the documentation."""

from pathlib import Path
from typing import Annotated

import typer


def docs(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where the pages go; what is there of an earlier site goes.")
    ] = Path("build/docs"),
    show: Annotated[bool, typer.Option("--open", help="Show it in a browser.")] = False,
) -> None:
    """Build the documentation as a site of plain files, which needs no network and no server."""
    from actors.installation.repository import clone
    from command_line.documentation import site

    clone("docs")
    home = site.build(out)
    print(home)
    if show:
        import webbrowser

        webbrowser.open(home.as_uri())
