"""A report in a folder: the page, its pictures as PNG and SVG, and its tables as comma-separated values."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from actors.runtime import regular_file
from experiments.report import cost_sections, findings, outcome_sections, style, time_sections
from experiments.report.cases import CaseSource, read
from experiments.report.cautions import cautions
from experiments.report.findings import Findings
from experiments.report.numbers import Cell, NumberTable
from experiments.report.origin_section import origin
from experiments.report.page import ReportPage, html
from experiments.report.section import ReportView, Section
from experiments.statistics.effect_size import Interval

PAGE: Final = "report.html"
_SECTIONS: Final[tuple[Callable[[ReportView], Section | None], ...]] = (
    outcome_sections.places,
    outcome_sections.running,
    outcome_sections.completion,
    outcome_sections.robots,
    time_sections.causes,
    time_sections.blockings,
    time_sections.decisions,
    cost_sections.radio,
    cost_sections.costs,
)


def write(folders: Sequence[Path], out: Path) -> Path:
    """Read campaigns and runs, write the report into the folder `out`, and give the page's path.

    The same folders give the same bytes. Raises AcrcError for a folder of which nothing
    can be told.
    """
    sources = read(folders)
    with style.applied():
        page = compose(sources)
        out.mkdir(parents=True, exist_ok=True)
        pictures = [section.picture for section in page.sections if section.picture is not None]
        drawn = {one.name: style.save(one.figure, out, one.name) for one in pictures}
        for table in tables(page):
            regular_file.write(out / f"{table.name}.csv", _csv(table).encode())
        regular_file.write(out / PAGE, html(page, drawn).encode())
    return out / PAGE


def compose(sources: Sequence[CaseSource]) -> ReportPage:
    """What the report says; pictures are drawn, so `style.applied` must hold."""
    view = ReportView(case for one in sources for case in one.cases)
    found = [Findings(one, one.judgement) for one in sources if one.judgement is not None]
    made = [section(view) for section in _SECTIONS] if view.groups else []
    failed = findings.failures(sources)
    return ReportPage(
        title="Report on " + ", ".join(one.name for one in sources),
        asked=[*findings.asked(sources), *dict.fromkeys(line for one in sources for line in one.protection)],
        found=[*(f"{one.name}: {line}." for one in sources for line in one.differing), *_found(found)],
        found_tables=[table for one in found for table in one.tables()],
        cautions=cautions(sources, found, view),
        sections=[
            *(section for section in made if section is not None),
            *([Section("Runs that failed", (), None, (failed,))] if failed is not None else []),
            origin(sources),
        ],
    )


def tables(page: ReportPage) -> list[NumberTable]:
    """All that hold anything, those of the sentences first."""
    every = [*page.found_tables, *(table for section in page.sections for table in section.tables)]
    return [table for table in every if table.rows]


def _found(found: Sequence[Findings]) -> list[str]:
    return [line for one in found for line in one.sentences()] or ["Nothing was compared."]


def _csv(table: NumberTable) -> str:
    into = io.StringIO()
    writer = csv.writer(into, lineterminator="\n")
    columns = [
        any(isinstance(row[place], Interval) for row in table.rows) for place in range(len(table.columns))
    ]
    writer.writerow(
        cell
        for name, is_interval in zip(table.columns, columns, strict=True)
        for cell in ((name, f"{name}, low", f"{name}, high") if is_interval else (name,))
    )
    for row in table.rows:
        writer.writerow(
            cell for one, is_interval in zip(row, columns, strict=True) for cell in _cells(one, is_interval)
        )
    return into.getvalue()


def _cells(cell: Cell, is_interval: bool) -> Sequence[Cell]:
    if not is_interval:
        return (cell,)
    if not isinstance(cell, Interval):
        return None, None, None
    return tuple(None if math.isnan(one) else one for one in cell)
