"""Pages parsed as CommonMark: headings, links, inline code, and code blocks."""

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
    """Number of its first line in the page, from 1."""


@dataclass(frozen=True)
class PageLink:
    """A link or picture; `target` is as written."""

    target: str

    @property
    def is_local(self) -> bool:
        """True if it leads to a file of the repository, or to a heading."""
        return not re.match(r"[a-z]+:", self.target)


class MarkdownPage:
    """A page in Markdown; `name` is its path relative to the repository."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = path.relative_to(REPOSITORY).as_posix()
        self.text = path.read_text(encoding="utf-8")

    @cached_property
    def _tokens(self) -> list[Token]:
        return _PARSER.parse(self.text)

    def blocks(self) -> list[Block]:
        """Return fenced blocks, in order."""
        return [
            Block(token.info.strip(), token.content, token.map[0] + 2 if token.map else 0)
            for token in self._tokens
            if token.type == "fence"
        ]

    def links(self) -> list[PageLink]:
        """Return links and pictures, in order."""
        parts = (part for token in self._tokens for part in token.children or ())
        targets = (part.attrGet("href") or part.attrGet("src") for part in parts)
        return [PageLink(str(target)) for target in targets if target]

    def codes(self) -> list[str]:
        """Return inline code, in order, each on one line."""
        parts = (part for token in self._tokens for part in token.children or ())
        return [" ".join(part.content.split()) for part in parts if part.type == "code_inline"]

    def anchors(self) -> set[str]:
        """Return the anchors of headings, as code hosts and the site generate them."""
        found: set[str] = set()
        for before, token in zip(self._tokens, self._tokens[1:], strict=False):
            if before.type == "heading_open":
                words = re.sub(r"[^\w\- ]", "", token.content.replace("`", "").lower()).replace(" ", "-")
                repeated = (f"{words}-{number}" for number in range(1, len(found) + 1))
                found.add(next(name for name in (words, *repeated) if name not in found))
        return found


@cache
def pages() -> tuple[MarkdownPage, ...]:
    """Return the pages of the root and of docs/, by name."""
    root = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
    return (*map(MarkdownPage, root), *map(MarkdownPage, sorted((REPOSITORY / "docs").rglob("*.md"))))
