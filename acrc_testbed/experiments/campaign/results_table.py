"""The results of a campaign as tables for other tools: a row for each trial, as Parquet and as CSV."""

import csv
import io
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from acrc_testbed.experiments.campaign.store import Store
from acrc_testbed.experiments.campaign.trial_record import CheckRecord, TrialRecord, keep_bytes
from acrc_testbed.experiments.study.study import Study
from acrc_testbed.results.outcome import means
from deploy.scenario.tables import inline

Row = dict[str, bool | int | float | str | None]
_NO_METRICS: Final = frozenset({"digest", "seed", "out", "bus", "isolation"})
"""Scalars of a result that stand in a column of their own, or say nothing of what came of the run."""


def write(store: Store) -> tuple[Path, Path]:
    """Write `results.parquet` and `results.csv` into the campaign's folder, and give their paths.

    Both have a row for each trial that has ended, in the study's order, and the same columns; each file is
    there whole or not at all. Raises AcrcError for a damaged record.
    """
    import pyarrow
    from pyarrow import parquet

    table = columns(store)
    binary = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(table), binary)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    paths = store.folder / "results.parquet", store.folder / "results.csv"
    for path, content in zip(paths, (binary.getvalue().to_pybytes(), text.getvalue().encode()), strict=True):
        keep_bytes(path, content)
    return paths


def columns(store: Store) -> dict[str, list[object]]:
    """The same by column, each of one type. Raises AcrcError for a damaged record."""
    table = list(rows(store))
    return {name: _column(row.get(name) for row in table) for name in _names(table)}


def rows(store: Store) -> Iterator[Row]:
    """A row for each trial that has ended. Columns with a dot in their name are parts of something larger."""
    checks = {_key(check): check for check in store.checks()}
    commit, scenario, tuning = store.commit, store.study.scenario, store.study.tuning
    for record in store.records():
        result = record.result
        origin = result.origin if result is not None else None
        row: Row = {
            "scenario": scenario,
            "strategy": record.strategy,
            "settings": _json(origin.settings) if origin is not None else None,
            "navigation.preset": origin.navigation if origin is not None else None,
            "seed": record.seed,
            "tuning": tuning,
            **{f"vary.{key}": _cell(value) for key, value in record.variant.items()},
            "drawn": _json(record.drawn),
            "command": command(store.study, record),
            "failure": record.failure,
            "commit": commit,
            "versions": _json(origin.versions) if origin is not None else None,
            "digest": result.digest if result is not None else None,
            **(_metrics(msgspec.to_builtins(result)) if result is not None else {}),
            **{f"outcome.{name}": mean for name, mean in means(result.outcome if result else {}).items()},
        }
        yield row | _checked(checks.get(_key(record)))


def command(study: Study, record: TrialRecord) -> str:
    """What one types to repeat the run alone."""
    words = ["acrc", "run", study.scenario, "--seed", str(record.seed), "--strategy", record.strategy]
    for key, value in (*study.settings_of(tuple(record.variant.items())), *record.drawn.items()):
        words += ["--set", f"{key}={inline(value)}"]
    return shlex.join(words)


def _metrics(result: Mapping[str, Any], prefix: str = "") -> Row:
    """All numbers of a result that are one of a run; its tables of such numbers by dotted names."""
    found: Row = {}
    for name, value in result.items():
        if isinstance(value, Mapping) and name not in {"per_robot", "frames_by_robot", "origin", "processor"}:
            found |= _metrics(value, f"{prefix}{name}.")
        elif isinstance(value, bool | int | float | str | None) and (prefix or name not in _NO_METRICS):
            found[prefix + name] = value
    return found


def _checked(check: CheckRecord | None) -> Row:
    if check is None:
        return {}
    return {
        "zenoh.digest": check.over_zenoh or None,
        "zenoh.real_time_factor": check.over_zenoh_speed,
        "zenoh.failure": check.failure,
    }


def _names(table: Iterable[Row]) -> list[str]:
    """Every row's columns, in the order in which they first come up."""
    return list(dict.fromkeys(name for row in table for name in row))


def _column(values: Iterable[object]) -> list[object]:
    """The values of one column, all of one type: numbers, or else texts."""
    column = list(values)
    kinds = {type(value) for value in column if value is not None}
    if kinds == {int, float}:
        return [float(value) if isinstance(value, int) else value for value in column]
    if len(kinds) > 1:
        return [
            None if value is None else value if isinstance(value, str) else _json(value) for value in column
        ]
    return column


def _cell(value: object) -> bool | int | float | str | None:
    return value if isinstance(value, bool | int | float | str | None) else _json(value)


def _json(value: object) -> str:
    return msgspec.json.encode(value, order="sorted").decode()


def _key(one: TrialRecord | CheckRecord) -> str:
    return _json((one.strategy, one.seed, one.variant))
