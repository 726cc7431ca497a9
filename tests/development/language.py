"""Banned words and sentence openings in docstrings, messages and pages; see `Style` in CONTRIBUTING.md."""

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY

WORDS: Final = re.compile(
    r"(?<![Tt]here )\b(?:is|are) no\b(?! longer| more)"
    r"|\b(nought|anew|somebody|nobody|whoever|comes? to|gets? on|holds? (?:itself|themselves) to be)\b",
    re.IGNORECASE,
)
OPENINGS: Final = re.compile(r"(?:^|[.:;]\s+)(?:What|Whether|Whose|Who|Whoever|Of)\b(?![^.]*\?)")
"""Openings of sentences without a subject; questions are allowed."""
_CODE: Final = re.compile(r"```.*?```|`[^`]*`", re.DOTALL)


def findings() -> Iterator[str]:
    """Yield `file:line: words` for every finding in tracked pages and Python sources of the product."""
    listed = subprocess.run(
        ["git", "ls-files", "*.py", "*.md"], cwd=REPOSITORY, capture_output=True, text=True, check=True
    ).stdout.split()
    for name in listed:
        path = REPOSITORY / name
        if name.endswith(".md") and name != "CHANGELOG.md" and not name.startswith("docs/reference/"):
            yield from _found(name, 1, _CODE.sub("", path.read_text("utf-8")))
        elif name.endswith(".py") and not name.startswith("tests/"):
            yield from _in_source(name, path)


def _in_source(name: str, path: Path) -> Iterator[str]:
    """Yield findings in strings with spaces of a source."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield from _found(name, node.lineno, node.value)


def _found(name: str, line: int, text: str) -> Iterator[str]:
    for pattern in (WORDS, OPENINGS):
        for match in pattern.finditer(text):
            words = match[0].strip(" .:;\n")
            yield f"{name}:{line + text.count(chr(10), 0, match.start())}: {words}"


if __name__ == "__main__":
    for finding in findings():
        print(finding)
