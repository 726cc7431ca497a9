"""A report in a folder: the page, its pictures as PNG and SVG, and its tables as comma-separated values."""

import csv
import io
import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from acrc_testbed.experiments.report import charts, findings, quantities, sections, time_sections
from acrc_testbed.experiments.report.cases import Case, CaseSource, read
from acrc_testbed.experiments.report.findings import Findings, cautions
from acrc_testbed.experiments.report.quantities import Cell, NumberTable, written
from acrc_testbed.experiments.report.section import ReportView, Section, label
from acrc_testbed.experiments.statistics.paired_tests import Interval
from acrc_testbed.experiments.study.study import Study
from acrc_testbed.page import rendering
from acrc_testbed.page.rendering import PagePicture, PageSection, PageTable
from actors.runtime import regular_file

PAGE: Final = "report.html"
_SECTIONS: Final[tuple[Callable[[ReportView], Section | None], ...]] = (
    sections.places,
    sections.running,
    sections.completion,
    sections.robots,
    time_sections.causes,
    time_sections.blockings,
    time_sections.decisions,
    sections.radio,
    sections.costs,
)


@dataclass(frozen=True)
class ReportPage:
    """Content of the page in reading order."""

    title: str
    asked: Sequence[str]
    found: Sequence[str]
    found_tables: Sequence[NumberTable]
    cautions: Sequence[str]
    sections: Sequence[Section]


def write(folders: Sequence[Path], out: Path) -> Path:
    """Read campaigns and runs, write the report into the folder `out`, and give the page's path.

    The same folders give the same bytes. Raises AcrcError for a folder of which nothing
    can be told.
    """
    sources = read(folders)
    with charts.applied():
        page = compose(sources)
        out.mkdir(parents=True, exist_ok=True)
        pictures = [section.picture for section in page.sections if section.picture is not None]
        drawn = {one.name: charts.save(one.figure, out, one.name) for one in pictures}
        for table in tables(page):
            regular_file.write(out / f"{table.name}.csv", _csv(table).encode())
        regular_file.write(out / PAGE, html(page, drawn).encode())
    return out / PAGE


def compose(sources: Sequence[CaseSource]) -> ReportPage:
    """What the report says; pictures are drawn, so `charts.applied` must hold."""
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


def html(page: ReportPage, drawn: Mapping[str, bytes]) -> str:
    """Return the HTML page; `drawn`: SVG of every picture by its name."""
    found = PageSection(
        "What was found", page.found, None, [_table(one) for one in page.found_tables], page.cautions
    )
    shown = [PageSection("What was asked", page.asked), found]
    for one in page.sections:
        picture = None
        if one.picture is not None:
            picture = PagePicture(drawn[one.picture.name], one.picture.alt, one.picture.caption)
        shown.append(PageSection(one.title, one.text, picture, [_table(table) for table in one.tables]))
    return rendering.html(page.title, shown)


def _table(table: NumberTable) -> PageTable:
    numeric = [
        any(not isinstance(row[place], str | None) for row in table.rows)
        for place in range(len(table.columns))
    ]
    rows = [[written(cell) for cell in row] for row in table.rows]
    return PageTable(table.caption, table.columns, rows, numeric, table.folded)


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


def origin(sources: Sequence[CaseSource]) -> Section:
    """Return the section with command, software, digest and numbers of every run."""
    digests = sum(
        case.outcome is not None and case.outcome.is_simulated for one in sources for case in one.cases
    )
    return Section(
        "How it was made",
        (
            "Scenario, seed and commit give the same digest on every processor: whoever runs them again must "
            f"find the digests below ({digests} of them).",
        ),
        None,
        (
            NumberTable(
                "folders", "The folders", ("folder", "commit", "command"),
                tuple((one.name, one.commit or "unknown", _command(one)) for one in sources),
            ),
            NumberTable("versions", "Beside that", ("package", "version", "runs"), tuple(_versions(sources))),
            NumberTable(
                "runs", "Every run",
                ("folder", "condition", "strategy", "navigation", "seed", "places", "of", "complete at, s",
                 "ended at, s", "length, s", "octets/s", "CPU ms/s", "failure", "digest"),
                tuple(_run(one, case) for one in sources for case in one.cases), folded=True,
            ),
        ),
    )  # fmt: skip


def _command(source: CaseSource) -> str:
    study = source.study
    if study is None:
        return "acrc run or acrc fleet collect"
    if study.factors or study.cells or study.distributions or study.conditions == "drawn":
        return f"acrc campaign with the study in {source.name}/study.json"
    return shlex.join(["acrc", "campaign", *_words(study)])


def _words(study: Study) -> Iterator[str]:
    yield from ("--scenario", study.scenario.rpartition("/")[2])
    yield from ("--strategies", ",".join(study.strategies), "--seeds", str(study.seeds))
    for key, value in study.settings:
        yield from ("--set", f"{key}={value}")
    if study.tuning:
        yield "--tuning"
    if study.isolated:
        yield "--isolate"


def _versions(sources: Sequence[CaseSource]) -> Iterator[tuple[Cell, ...]]:
    found: dict[tuple[str, str], int] = {}
    for case in (case for one in sources for case in one.cases):
        if case.outcome is not None:
            for pair in case.outcome.origin.versions.items():
                found[pair] = found.get(pair, 0) + 1
    for (package, version), runs in found.items():
        yield package, version, runs


def _run(source: CaseSource, case: Case) -> tuple[Cell, ...]:
    origin = None if case.outcome is None or not case.outcome.is_simulated else case.outcome.origin
    navigation = origin.navigation or None if origin is not None else None
    seed = None if case.seed is None else str(case.seed)
    who = (source.name, case.condition, label(case.strategy), navigation, seed)
    if case.outcome is None:
        return (*who, *[None] * 7, case.failure, None)
    one = case.outcome
    return (
        *who, quantities.places(one), one.places_total, one.completion_s, one.settled_s,
        quantities.length_s(one), quantities.octets(one), quantities.cpu_ms(one), case.failure,
        one.digest if one is not None and one.is_simulated else None,
    )  # fmt: skip
