"""Rows of a list: for people as a table, for programs as JSON; and what each row says of itself.

The sentences are those that stand at the things themselves: in docstrings, and at the head of files.
"""

import ast
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import msgspec


def print_rows(rows: Sequence[msgspec.Struct], columns: Mapping[str, Sequence[str]], *, json: bool) -> None:
    """Print on standard output: all of the rows as JSON, or the cells of each column, by its title."""
    if json:
        sys.stdout.write(msgspec.json.encode(rows).decode() + "\n")
        return
    from rich.table import Table

    from actors.console import print_table, screen

    table = Table(*columns, box=None, pad_edge=False)
    for cells in zip(*columns.values(), strict=True):
        table.add_row(*cells)
    print_table(screen(), table)


def head_comment(text: str) -> str:
    """The first sentence of the comment that a TOML file begins with; empty if there is none."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.removeprefix("#").strip())
    return re.split(r"(?<=\.)\s", " ".join(lines), maxsplit=1)[0]


def constant_doc(source: Path, name: str) -> str:
    """The docstring below the module's constant `name`, on one line."""
    body = ast.parse(source.read_text(encoding="utf-8")).body
    for here, below in pairwise(body):
        if _assigns(here, name) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            return " ".join(str(below.value.value).split())
    return ""


def constant_keys(source: Path, name: str) -> list[str]:
    """The keys of the module's constant `name`, a mapping written out in full."""
    for statement in ast.parse(source.read_text(encoding="utf-8")).body:
        if _assigns(statement, name):
            written = next(node for node in ast.walk(statement) if isinstance(node, ast.Dict))
            return [ast.literal_eval(key) for key in written.keys if key is not None]
    return []


def _assigns(statement: ast.stmt, name: str) -> bool:
    targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
    return any(isinstance(target, ast.Name) and target.id == name for target in targets)


def said_of(name: str, doc: str) -> str:
    """What a docstring of the form "`name`: this. `other`: that." says of `name`; empty if nothing.

    Without what is in brackets, and only up to the first stop, colon or semicolon.
    """
    found = re.search(rf"`{re.escape(name)}`[^:`]*: (.+?)[.:;](?: |$)", re.sub(r" \([^()]*\)", "", doc))
    return found[1] if found else ""
