"""Pages of sections with text, a picture and tables, rendered by the template `page.html`."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import jinja2

from actors.runtime.errors import printable


class PageTable(NamedTuple):
    """A table of formatted cells; omitted if it has no rows."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]
    """True for columns of numbers."""
    folded: bool = False
    """Show the table collapsed."""


class PagePicture(NamedTuple):
    """A drawing embedded in a page."""

    svg: bytes
    alt: str
    caption: str

    @property
    def base64(self) -> str:
        """The drawing in base64."""
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
    """Render a page; all texts are escaped."""
    return _TEMPLATES.get_template("page.html").render(title=title, sections=sections)
