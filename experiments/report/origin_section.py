"""How the runs were made, so that somebody else can make them again."""

import shlex
from collections.abc import Iterator, Sequence

from experiments.report import quantities
from experiments.report.cases import Case, CaseSource
from experiments.report.numbers import Cell, NumberTable
from experiments.report.section import Section, label
from experiments.study.study import Study
from observation.results.result import RunResult


def origin(sources: Sequence[CaseSource]) -> Section:
    """Command, software and digest of every run, and the numbers of each that pictures show."""
    digests = sum(isinstance(case.outcome, RunResult) for one in sources for case in one.cases)
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
        if isinstance(case.outcome, RunResult):
            for pair in case.outcome.origin.versions.items():
                found[pair] = found.get(pair, 0) + 1
    for (package, version), runs in found.items():
        yield package, version, runs


def _run(source: CaseSource, case: Case) -> tuple[Cell, ...]:
    origin = case.outcome.origin if isinstance(case.outcome, RunResult) else None
    navigation = origin.navigation or None if origin is not None else None
    seed = None if case.seed is None else str(case.seed)
    who = (source.name, case.condition, label(case.strategy), navigation, seed)
    if case.outcome is None:
        return (*who, *[None] * 7, case.failure, None)
    one = case.outcome
    return (
        *who, quantities.places(one), one.places_total, one.completion_s, one.settled_s,
        quantities.length_s(one), quantities.octets(one), quantities.cpu_ms(one), case.failure,
        one.digest if isinstance(one, RunResult) else None,
    )  # fmt: skip
