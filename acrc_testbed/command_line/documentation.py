"""Command `acrc docs`: the documentation as a site, with a generated page of all commands."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from acrc_testbed.command_line.shared_options import flag, option

_HEADING: Final = "# Commands\n\n`acrc docs` generates this page from the output of `acrc COMMAND --help`."


def docs(
    out: Annotated[Path, option("DIR", "Write the pages to this folder.")] = Path("build/docs"),
    show: Annotated[bool, flag("Open the site in a browser.", "--open")] = False,
) -> None:
    """Build the documentation as a static site.

    Requires no network and no server.
    """
    from actors.installation.repository import clone

    home = build(clone("docs") / "docs", out)
    print(home)
    if show:
        import webbrowser

        webbrowser.open(home.as_uri())


def build(pages: Path, out: Path) -> Path:
    """Write the site of the folder `pages` into the folder `out` and return its home page.

    Raises AcrcError if Sphinx prints a warning.
    """
    from sphinx.cmd.build import build_main

    from actors.processes.launcher import scratch_folder
    from actors.runtime.errors import AcrcError

    reference = pages / "reference" / "commands.md"
    if reference.read_text() != (page := commands_page()):
        reference.write_text(page)
    with scratch_folder() as trees:
        options = ("--fail-on-warning", "--keep-going", "--quiet", "--fresh-env", "-d", str(trees))
        if build_main([*options, str(pages), str(out)]):
            raise AcrcError(f"docs: warnings in {pages}, see above")
    return (out / "index.html").resolve()


def command_tree() -> dict[str, Any]:
    """Return every visible command and group by its full name; "acrc" is the root."""
    from acrc_testbed.command_line.app import app

    found: dict[str, Any] = {}
    pending: list[tuple[str, Any]] = [("acrc", typer.main.get_command(app))]
    while pending:
        words, command = pending.pop(0)
        found[words] = command
        pending[:0] = [(f"{words} {name}", one) for name, one in _subcommands(command)]
    return found


def _subcommands(command: Any) -> list[tuple[str, Any]]:
    """Return the visible commands of a group, in order."""
    if not hasattr(command, "list_commands"):
        return []
    named = [(name, command.get_command(None, name)) for name in command.list_commands(None)]
    return [(name, one) for name, one in named if not one.hidden]


def commands_page() -> str:
    """Return the page: a section per command with usage, help and a table of parameters."""
    sections = [_section(words, command) for words, command in command_tree().items()]
    return "\n\n".join([_HEADING, *sections]) + "\n"


def _section(words: str, command: Any) -> str:
    context = command.make_context(words, [], resilient_parsing=True)
    usage = " ".join(f"{words} {' '.join(command.collect_usage_pieces(context))}".split())
    text = re.sub(r"[ \t]*\n[ \t]*", "\n", (command.help or "").partition("\f")[0].strip())
    level = "#" * min(4, len(words.split()) + 1)
    parts = [f"{level} {words}", _escaped(text), f"```text\n{usage}\n```"]
    if rows := list(_rows(command, context)):
        parts.append("\n".join(["| | |", "|---|---|", *rows]))
    return "\n\n".join(part for part in parts if part)


def _rows(command: Any, context: Any) -> Iterator[str]:
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and "--help" not in parameter.opts:
            yield f"| `{record[0].replace('|', chr(92) + '|')}` | {_escaped(record[1])} |"
    for name, one in _subcommands(command):
        anchor = f"{context.info_name} {name}".replace(" ", "-")
        yield f"| [`{name}`](#{anchor}) | {_escaped(one.get_short_help_str(200))} |"


def _escaped(text: str) -> str:
    """Escape plain text for Markdown, except backticks."""
    pieces = re.split(r"(`[^`\n]+`)", " ".join(text.split()))
    return "".join(
        piece.replace("|", r"\|") if number % 2 else re.sub(r"([\\*_<>\[\]|#])", r"\\\1", piece)
        for number, piece in enumerate(pieces)
    )
