"""What the pages hold, as CommonMark has it: headings, links, code in the text, and blocks of code."""

import re
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Final

from markdown_it import MarkdownIt
from markdown_it.token import Token

from actors.installation.repository import REPOSITORY

_PARSER: Final = MarkdownIt("commonmark").enable("table")


@dataclass(frozen=True)
class Block:
    """A fenced block of code."""

    language: str
    text: str
    line: int
    """Of its first line in the page, counted from 1."""


@dataclass(frozen=True)
class PageLink:
    """A link or picture; `target` is as written."""

    target: str

    @property
    def is_local(self) -> bool:
        """Whether it leads to a file of the repository, or to a heading."""
        return not re.match(r"[a-z]+:", self.target)


class MarkdownPage:
    """A page in Markdown; `name` is its path seen from the root of the repository."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = path.relative_to(REPOSITORY).as_posix()
        self.text = path.read_text(encoding="utf-8")

    @cached_property
    def _tokens(self) -> list[Token]:
        return _PARSER.parse(self.text)

    def blocks(self) -> list[Block]:
        """Fenced blocks, in order."""
        return [
            Block(token.info.strip(), token.content, token.map[0] + 2 if token.map else 0)
            for token in self._tokens
            if token.type == "fence"
        ]

    def links(self) -> list[PageLink]:
        """Links and pictures, in order."""
        parts = (part for token in self._tokens for part in token.children or ())
        targets = (part.attrGet("href") or part.attrGet("src") for part in parts)
        return [PageLink(str(target)) for target in targets if target]

    def codes(self) -> list[str]:
        """What stands in backticks within the text, in order, each on one line."""
        parts = (part for token in self._tokens for part in token.children or ())
        return [" ".join(part.content.split()) for part in parts if part.type == "code_inline"]

    def anchors(self) -> set[str]:
        """The names of its headings in links, as code hosts and the site make them."""
        found: set[str] = set()
        for before, token in zip(self._tokens, self._tokens[1:], strict=False):
            if before.type == "heading_open":
                words = re.sub(r"[^\w\- ]", "", token.content.replace("`", "").lower()).replace(" ", "-")
                repeated = (f"{words}-{number}" for number in range(1, len(found) + 1))
                found.add(next(name for name in (words, *repeated) if name not in found))
        return found


@cache
def pages() -> tuple[MarkdownPage, ...]:
    """The pages of the root, and everything in docs/, by name."""
    root = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    return (*map(MarkdownPage, root), *map(MarkdownPage, sorted((REPOSITORY / "docs").rglob("*.md"))))
