"""The reference of the command line, made from the command line itself: docs/reference/commands.md."""

import re
from collections.abc import Iterator
from typing import Any, Final

import typer

from command_line.app import app

_HEAD: Final = (
    "# Commands\n\n`acrc COMMAND --help` says the same. `acrc docs` makes this page from the command line."
)


def tree() -> dict[str, Any]:
    """Every command and group that `--help` shows, by the words that call it, the root by "acrc"."""
    found: dict[str, Any] = {}
    todo: list[tuple[str, Any]] = [("acrc", typer.main.get_command(app))]
    while todo:
        words, command = todo.pop(0)
        found[words] = command
        todo[:0] = [(f"{words} {name}", one) for name, one in _below(command)]
    return found


def _below(command: Any) -> list[tuple[str, Any]]:
    """The commands of a group, by name, in its order."""
    if not hasattr(command, "list_commands"):
        return []
    named = [(name, command.get_command(None, name)) for name in command.list_commands(None)]
    return [(name, one) for name, one in named if not one.hidden]


def as_markdown() -> str:
    """The page: a section for each, with its words, what it does, and a table of what it takes."""
    sections = [_section(words, command) for words, command in tree().items()]
    return "\n\n".join([_HEAD, *sections]) + "\n"


def _section(words: str, command: Any) -> str:
    context = command.make_context(words, [], resilient_parsing=True)
    usage = " ".join(f"{words} {' '.join(command.collect_usage_pieces(context))}".split())
    level = "#" * min(4, len(words.split()) + 1)
    parts = [f"{level} {words}", _escaped(_first_paragraphs(command)), f"```text\n{usage}\n```"]
    if rows := list(_rows(command, context)):
        parts.append("\n".join(["| | |", "|---|---|", *rows]))
    return "\n\n".join(part for part in parts if part)


def _first_paragraphs(command: Any) -> str:
    return re.sub(r"[ \t]*\n[ \t]*", "\n", (command.help or "").partition("\f")[0].strip())


def _rows(command: Any, context: Any) -> Iterator[str]:
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and "--help" not in parameter.opts:
            yield f"| `{record[0].replace('|', chr(92) + '|')}` | {_escaped(record[1])} |"
    for name, one in _below(command):
        anchor = f"{context.info_name} {name}".replace(" ", "-")
        yield f"| [`{name}`](#{anchor}) | {_escaped(one.get_short_help_str(200))} |"


def _escaped(text: str) -> str:
    """Plain text as Markdown: what is in backticks stays code, nothing else means anything."""
    pieces = re.split(r"(`[^`\n]+`)", " ".join(text.split()))
    return "".join(
        piece.replace("|", r"\|") if number % 2 else re.sub(r"([\\*_<>\[\]|#])", r"\\\1", piece)
        for number, piece in enumerate(pieces)
    )
