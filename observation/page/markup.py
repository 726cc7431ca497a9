"""What pages are made of; every text in them is escaped, whoever wrote it."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from string import Template
from typing import Final

from actors.runtime.errors import printable
from observation.page.page_style import CSS

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


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page of parts that the other functions gave."""
    return _PAGE.substitute(title=text(title), css=CSS, body="\n".join(parts))


def text(words: str) -> str:
    """Words as they may stand anywhere in a page."""
    return escape(printable(words), quote=True)


def navigation(titles: Iterable[str]) -> str:
    """Links to the headings of a page, numbered from 1."""
    items = "".join(
        f'<li><a href="#s{number}">{text(title)}</a></li>' for number, title in enumerate(titles, start=1)
    )
    return f'<nav aria-label="contents"><ul>{items}</ul></nav>'


def heading(number: int, title: str) -> str:
    """A heading that `navigation` leads to."""
    return f'<h2 id="s{number}">{text(title)}</h2>'


def paragraph(words: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{text(words)}</p>"


def picture(svg: bytes, alt: str, caption: str) -> str:
    """A drawing within the page; `alt` is for those who do not see it."""
    drawn = base64.b64encode(svg).decode()
    image = f'<img src="{_OF_SVG}{drawn}" alt="{text(alt)}">'
    return f"<figure>{image}<figcaption>{text(caption)}</figcaption></figure>"


def table(
    caption: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Sequence[bool],
    *,
    folded: bool = False,
) -> str:
    """A table, empty without rows; `numeric` says of each column whether it holds numbers.

    Folded, it is shown once it is asked for.
    """
    if not rows:
        return ""
    head = "".join(
        f'<th scope="col"{_number_class(is_number)}>{text(column)}</th>'
        for column, is_number in zip(columns, numeric, strict=True)
    )
    lines = "".join(f"<tr>{''.join(map(_cell, row, numeric))}</tr>\n" for row in rows)
    said = "" if folded else f"<caption>{text(caption)}</caption>"
    body = f"<thead><tr>{head}</tr></thead>\n<tbody>\n{lines}</tbody>"
    told = f'<div class="wide"><table>{said}{body}</table></div>'
    return f"<details><summary>{text(caption)}</summary>{told}</details>" if folded else told


def _cell(words: str, is_number: bool) -> str:
    return f"<td{_number_class(is_number)}>{text(words)}</td>"


def _number_class(is_number: bool) -> str:
    return ' class="number"' if is_number else ""
