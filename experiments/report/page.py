"""One HTML page that needs nothing beside itself; every text in it is escaped, whoever wrote it."""

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from string import Template
from typing import Final

from actors.runtime.errors import printable
from experiments.report.numbers import Cell, Table, written
from experiments.report.page_style import CSS
from experiments.report.section import Picture, Section

_PAGE: Final = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>$css</style>
</head>
<body>
<main>
<h1>$title</h1>
$body
</main>
</body>
</html>
""")
_OF_SVG: Final = "data:image/svg+xml;base64,"


@dataclass(frozen=True)
class Page:
    """All that the page says, in the order in which it is read."""

    title: str
    asked: Sequence[str]
    found: Sequence[str]
    found_tables: Sequence[Table]
    cautions: Sequence[str]
    sections: Sequence[Section]


def html(page: Page, drawn: Mapping[str, bytes]) -> str:
    """The page; `drawn`: every picture's SVG by its name."""
    titles = ["What was asked", "What was found", *(one.title for one in page.sections)]
    parts = [
        _navigation(titles),
        _heading(1, titles[0]),
        *map(_paragraph, page.asked),
        _heading(2, titles[1]),
        *map(_paragraph, page.found),
        *_cautions(page.cautions),
        *map(_table, page.found_tables),
    ]
    for number, section in enumerate(page.sections, start=3):
        parts += [_heading(number, section.title), *_section(section, drawn)]
    return _PAGE.substitute(title=_text(page.title), css=CSS, body="\n".join(parts))


def _text(text: str) -> str:
    return escape(printable(text), quote=True)


def _navigation(titles: Iterable[str]) -> str:
    items = "".join(
        f'<li><a href="#s{number}">{_text(title)}</a></li>' for number, title in enumerate(titles, start=1)
    )
    return f'<nav aria-label="contents"><ul>{items}</ul></nav>'


def _heading(number: int, title: str) -> str:
    return f'<h2 id="s{number}">{_text(title)}</h2>'


def _paragraph(text: str) -> str:
    return f"<p>{_text(text)}</p>"


def _cautions(sentences: Sequence[str]) -> Iterator[str]:
    if sentences:
        items = "".join(f"<li>{_text(one)}</li>" for one in sentences)
        yield (
            '<aside class="cautions" aria-label="warnings"><h2>Before you quote it</h2>'
            f"<ul>{items}</ul></aside>"
        )


def _section(section: Section, drawn: Mapping[str, bytes]) -> Iterator[str]:
    yield from map(_paragraph, section.text)
    if section.picture is not None:
        yield _picture(section.picture, drawn[section.picture.name])
    yield from map(_table, section.tables)


def _picture(picture: Picture, svg: bytes) -> str:
    drawn = base64.b64encode(svg).decode()
    return (
        f'<figure><img src="{_OF_SVG}{drawn}" alt="{_text(picture.alt)}">'
        f"<figcaption>{_text(picture.caption)}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    if not table.rows:
        return ""
    numeric = [
        any(not isinstance(row[place], str | None) for row in table.rows)
        for place in range(len(table.columns))
    ]
    head = "".join(
        f'<th scope="col"{_number_class(is_number)}>{_text(column)}</th>'
        for column, is_number in zip(table.columns, numeric, strict=True)
    )
    rows = "".join(f"<tr>{''.join(map(_cell, row, numeric))}</tr>\n" for row in table.rows)
    caption = "" if table.folded else f"<caption>{_text(table.caption)}</caption>"
    body = f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>"
    told = f'<div class="wide"><table>{caption}{body}</table></div>'
    return f"<details><summary>{_text(table.caption)}</summary>{told}</details>" if table.folded else told


def _cell(cell: Cell, is_number: bool) -> str:
    return f"<td{_number_class(is_number)}>{_text(written(cell))}</td>"


def _number_class(is_number: bool) -> str:
    return ' class="number"' if is_number else ""
