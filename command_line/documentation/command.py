"""The command of the documentation."""

from pathlib import Path
from typing import Annotated

import typer


def docs(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the pages; an earlier site there is replaced.")
    ] = Path("build/docs"),
    show: Annotated[bool, typer.Option("--open", help="Open it in a browser.")] = False,
) -> None:
    """Build the documentation as a site of plain files.

    It needs no network and no server.
    """
    from actors.installation.repository import clone
    from command_line.documentation import site

    clone("docs")
    home = site.build(out)
    print(home)
    if show:
        import webbrowser

        webbrowser.open(home.as_uri())
