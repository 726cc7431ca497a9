"""Pages of sections with text, a picture and tables, rendered by the template `page.html`."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import jinja2

from actors.runtime.errors import printable


class PageTable(NamedTuple):
    """A table of written cells; without rows it is left out."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]
    """Whether each column holds numbers."""
    folded: bool = False
    """Show the table only when the reader opens it."""


class PagePicture(NamedTuple):
    """A drawing within the page."""

    svg: bytes
    alt: str
    """Description for readers who do not see it."""
    caption: str

    @property
    def base64(self) -> str:
        """The drawing as a data URL holds it."""
        return base64.b64encode(self.svg).decode()


@dataclass(frozen=True)
class PageSection:
    """A section of a page."""

    title: str
    text: Sequence[str] = ()
    picture: PagePicture | None = None
    tables: Sequence[PageTable] = ()
    warnings: Sequence[str] = ()

    @property
    def is_empty(self) -> bool:
        """True if only the title would be shown."""
        return not (self.text or self.picture or self.warnings or any(one.rows for one in self.tables))


def _printable(value: object) -> object:
    return printable(value) if type(value) is str else value  # Markup, a subclass, is the template's own


_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, finalize=_printable,
    keep_trailing_newline=True,
)  # fmt: skip


def html(title: str, sections: Sequence[PageSection]) -> str:
    """Return a page; every text in it is escaped."""
    return _TEMPLATES.get_template("page.html").render(title=title, sections=sections)
