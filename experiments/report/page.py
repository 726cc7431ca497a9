"""The report as one HTML page that needs nothing beside itself."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from experiments.report.numbers import NumberTable, written
from experiments.report.section import Section
from observation.page import markup


@dataclass(frozen=True)
class ReportPage:
    """All that the page says, in the order in which it is read."""

    title: str
    asked: Sequence[str]
    found: Sequence[str]
    found_tables: Sequence[NumberTable]
    cautions: Sequence[str]
    sections: Sequence[Section]


def html(page: ReportPage, drawn: Mapping[str, bytes]) -> str:
    """The page; `drawn`: every picture's SVG by its name."""
    titles = ["What was asked", "What was found", *(one.title for one in page.sections)]
    parts = [
        markup.navigation(titles),
        markup.heading(1, titles[0]),
        *map(markup.paragraph, page.asked),
        markup.heading(2, titles[1]),
        *map(markup.paragraph, page.found),
        *_cautions(page.cautions),
        *map(_table, page.found_tables),
    ]
    for number, section in enumerate(page.sections, start=3):
        parts += [markup.heading(number, section.title), *_section(section, drawn)]
    return markup.page(page.title, parts)


def _cautions(sentences: Sequence[str]) -> Iterator[str]:
    if sentences:
        items = "".join(f"<li>{markup.text(one)}</li>" for one in sentences)
        yield (
            '<aside class="cautions" aria-label="warnings"><h2>Before you quote it</h2>'
            f"<ul>{items}</ul></aside>"
        )


def _section(section: Section, drawn: Mapping[str, bytes]) -> Iterator[str]:
    yield from map(markup.paragraph, section.text)
    if section.picture is not None:
        picture = section.picture
        yield markup.picture(drawn[picture.name], picture.alt, picture.caption)
    yield from map(_table, section.tables)


def _table(table: NumberTable) -> str:
    numeric = [
        any(not isinstance(row[place], str | None) for row in table.rows)
        for place in range(len(table.columns))
    ]
    rows = [[written(cell) for cell in row] for row in table.rows]
    return markup.table(table.caption, table.columns, rows, numeric, folded=table.folded)
