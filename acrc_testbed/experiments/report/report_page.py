"""Composition of a report: HTML page, pictures as PNG and SVG, tables as CSV."""

import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from acrc_testbed.experiments.metrics import total_of
from acrc_testbed.experiments.report import charts, findings, sections, time_sections
from acrc_testbed.experiments.report.report_view import (
    REAL,
    Cell,
    ReportView,
    Row,
    RunSource,
    is_known,
    metric_value,
    read_sources,
    strategy_label,
)
from acrc_testbed.experiments.store import difference_sentences, isolation_sentences
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.picture import html_page as rendering
from acrc_testbed.picture.html_page import PageSection
from acrc_testbed.picture.style import context as settings_context
from actors.runtime import regular_file

PAGE: Final = "report.html"
_SECTIONS: Final = (
    sections.robots,
    time_sections.causes,
    time_sections.blockings,
    time_sections.decisions,
    sections.radio,
    sections.costs,
)


class ReportPage(NamedTuple):
    """Content of a report's page."""

    title: str
    sections: Sequence[PageSection]


def write(folders: Sequence[Path], out: Path) -> Path:
    """Write a report on campaigns and runs into the folder `out`; return the page's path.

    Reproducible. Raises AcrcError for a folder without a campaign or run.
    """
    sources = read_sources(folders)
    out.mkdir(parents=True, exist_ok=True)
    page = compose(sources, out)
    regular_file.write_atomically(out / PAGE, rendering.html(*page).encode())
    return out / PAGE


def compose(sources: Sequence[RunSource], out: Path) -> ReportPage:
    """Compose the page, and write its pictures and tables into the folder `out`."""
    sources = [
        one
        if one.evaluation is None
        else replace(one, evaluation=findings.with_upper_bounds_marked(one.evaluation))
        for one in sources
    ]
    view = ReportView(sources, out)
    evaluations = [(one.name, one.evaluation) for one in sources if one.evaluation is not None]
    stores = [(one.name, one.store) for one in sources if one.store is not None]
    description = [
        *map(findings.study_sentence, sources),
        *dict.fromkeys(line for _, one in stores for line in isolation_sentences(one)),
    ]
    different = [f"{name}: {line}." for name, one in stores for line in difference_sentences(one)]
    verdicts = [line for _, one in evaluations for line in findings.sentences(one)] or [
        "Nothing was compared."
    ]
    tables = [table for name, one in evaluations for table in findings.tables(view, name, one)]
    with settings_context(charts.STYLE):
        of_task = sections.task_sections(view) if view.groups else ()
        drawn = [*of_task, *(section(view) for section in _SECTIONS)] if view.groups else []
    failed = findings.failures(view, sources)
    shown = [
        PageSection("Study", description),
        PageSection("Results", [*different, *verdicts], None, tables, findings.caveats(sources, view)),
        *(section for section in drawn if section is not None),
        *([PageSection("Failed runs", (), None, (failed,))] if failed.rows else []),
        origin(view, sources),
    ]
    return ReportPage("Report on " + ", ".join(one.name for one in sources), shown)


def origin(view: ReportView, sources: Sequence[RunSource]) -> PageSection:
    """Return the section on reproduction: commands, versions, and results of every run."""
    digests = sum(run.is_simulated for run in view.results)
    folders = view.table(
        "folders",
        "Folders",
        [
            {"folder": one.name, "commit": one.commit or "unknown", "command": _command_text(one)}
            for one in sources
        ],
    )
    versions = view.table("versions", "Package versions", _version_rows(sources))
    runs = view.table(
        "runs",
        "All runs",
        [
            {"folder": one.name, "condition": condition, **_run_row(view, condition, record)}
            for one in sources
            for condition, record in zip(one.conditions, one.records, strict=True)
        ],
        folded=True,
    )
    text = (
        "Scenario, seed and commit determine the digest on any processor: repeated runs must have the "
        f"{digests} digests below.",
    )
    return PageSection("Reproduction", text, None, (folders, versions, runs))


def _command_text(source: RunSource) -> str:
    study = source.study
    if study is None:
        return "acrc run or acrc fleet collect"
    if study.factors or study.cells or study.distributions or study.conditions == "drawn":
        return f"acrc campaign {source.name}/study.json --out again"
    return shlex.join(["acrc", "campaign", *_option_words(study)])


def _option_words(study: Study) -> Iterator[str]:
    yield from ("--scenario", study.scenario.rpartition("/")[2])
    yield from ("--strategies", ",".join(study.strategies), "--seeds", str(study.seeds))
    for key, value in study.settings:
        yield from ("--set", f"{key}={value}")
    if study.tuning:
        yield "--tuning"
    if study.isolated:
        yield "--isolate"


def _version_rows(sources: Sequence[RunSource]) -> list[Row]:
    found = Counter(
        pair
        for one in sources
        for record in one.records
        if record.result is not None and record.result.is_simulated
        for pair in record.result.origin.versions.items()
    )
    return [
        {"package": package, "version": version, "runs": runs} for (package, version), runs in found.items()
    ]


def _run_row(view: ReportView, condition: str, record: TrialRecord) -> Row:
    run = record.result
    simulated = run is not None and run.is_simulated
    cells: dict[str, Cell] = {
        "strategy": strategy_label(record.strategy),
        "navigation": run.origin.navigation or None if run is not None and simulated else None,
        "seed": None if condition == REAL else str(record.seed),
    }
    for one in view.task.metrics:
        cells[sections.titled(one)] = None
        if run is not None and is_known(one, (run,)) and metric_value(one, run).done:
            cells[sections.titled(one)] = metric_value(one, run).at
        if one.total:
            cells[f"{one.name}, total"] = None if run is None else total_of(one, run)
    return cells | {
        "length, s": None if run is None else run.length_s,
        "octets/s": None if run is None else run.radio_bytes_per_robot_s,
        "CPU ms/s": None if run is None else sections.cpu_ms(run),
        "failure": record.failure,
        "digest": run.digest if run is not None and simulated else None,
    }
