"""Our filter beside another one that was fed with the same logs: paired log by log."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from rich.table import Table

from actors.runtime import typed_json
from benchmarks.localisation.log import LogError
from benchmarks.localisation.metrics import Run
from benchmarks.localisation.summary import resampled

_LARGEST: Final = 10_000_000


class OtherRun(msgspec.Struct):
    """What another localisation made of a log, from one seed; fields that are not needed may be there too."""

    rmse: float
    """Over all poses, m."""
    lost: bool
    """More than 1 m off at the end."""
    nmed: float | None = None
    """Median of the normalised error (NEES)."""


class Other(msgspec.Struct):
    """All runs on one log."""

    log: str
    """The log's file name, without .zip."""
    runs: list[OtherRun]


@dataclass(frozen=True)
class PairedRow:
    """One log, or all of them together."""

    log: str
    preset: str
    ours: float
    """Mean error, m; of all logs, the geometric mean."""
    theirs: float
    ratio: float
    low: float
    high: float
    """The ratio of the two, with its 95 % interval: a bootstrap over the runs of each, and over the logs."""
    lost: str
    """Runs, ours and theirs."""
    nees: str
    """Median over the runs, ours and theirs."""


def load(file: Path) -> dict[str, Other]:
    """By log, what another localisation made of it. Raises LogError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise LogError(f"{file}: may have at most {_LARGEST} bytes, and has more.")
        others = typed_json.decode(data, list[Other])
    except OSError as error:
        raise LogError(f"{file}: cannot be read: {error.strerror}.") from None
    except ValueError as error:
        raise LogError(
            f"{file}: must be a list of logs, each with its runs (docs/localisation-log.md): {error}."
        ) from None
    for other in others:
        if not other.runs or not all(math.isfinite(run.rmse) and run.rmse > 0 for run in other.runs):
            raise LogError(f"{file}: {other.log[:80]}: must have runs, each with an rmse above 0.")
    return {other.log: other for other in others}


def rows(ours: Mapping[str, Mapping[str, Sequence[Run]]], others: Mapping[str, Other]) -> list[PairedRow]:
    """A row per preset and log, and one for all logs. `ours`: runs by log and preset, as others have them."""
    found = []
    for preset in dict.fromkeys(preset for by_preset in ours.values() for preset in by_preset):
        its = [_row(log, preset, by[preset], others[log]) for log, by in ours.items()]
        found += its
        if len(its) > 1:
            found.append(_together(preset, its, ours, others))
    return found


def as_good(
    found: Sequence[PairedRow],
    ours: Mapping[str, Mapping[str, Sequence[Run]]],
    others: Mapping[str, Other],
    preset: str,
) -> bool:
    """Whether that preset errs no more than the other one, over all logs, and is lost no more often."""
    ratio = [row.ratio for row in found if row.preset == preset][-1]
    lost = sum(run.lost for by_preset in ours.values() for run in by_preset[preset])
    of = sum(len(by_preset[preset]) for by_preset in ours.values())
    their = [run.lost for log in ours for run in others[log].runs]
    return ratio <= 1.0 and lost / of <= sum(their) / len(their)


def table(found: Sequence[PairedRow]) -> Table:
    """For people."""
    shown = Table(title="beside another localisation, on the same logs")
    for column in ("log", "preset", "error, m", "other's", "ratio", "lost", "NEES"):
        shown.add_column(column, no_wrap=True)
    for row in found:
        ratio = f"{row.ratio:.2f} [{row.low:.2f}, {row.high:.2f}]"
        shown.add_row(row.log, row.preset, f"{row.ours:.3f}", f"{row.theirs:.3f}", ratio, row.lost, row.nees)
    return shown


def _row(log: str, preset: str, runs: Sequence[Run], other: Other) -> PairedRow:
    ours = np.array([run.rmse for run in runs])
    theirs = np.array([run.rmse for run in other.runs])
    drawn = resampled(ours) / resampled(theirs)
    low, high = np.percentile(drawn, (2.5, 97.5)).tolist()
    lost = f"{sum(run.lost for run in runs)}/{len(runs)}, {sum(run.lost for run in other.runs)}/{len(theirs)}"
    nees = (_median([float(np.median(run.nees)) for run in runs]), _median([r.nmed for r in other.runs]))
    return PairedRow(
        log, preset, float(ours.mean()), float(theirs.mean()), float(ours.mean() / theirs.mean()),
        low, high, lost, f"{nees[0]}, {nees[1]}",
    )  # fmt: skip


def _together(
    preset: str,
    its: Sequence[PairedRow],
    ours: Mapping[str, Mapping[str, Sequence[Run]]],
    others: Mapping[str, Other],
) -> PairedRow:
    ratios = np.log([row.ratio for row in its])
    low, high = np.exp(np.percentile(resampled(ratios), (2.5, 97.5))).tolist()
    own = [run.lost for row in its for run in ours[row.log][preset]]
    their = [run.lost for row in its for run in others[row.log].runs]
    return PairedRow(
        f"all {len(its)}", preset, _geometric([row.ours for row in its]), _geometric([r.theirs for r in its]),
        float(np.exp(ratios.mean())), low, high, f"{sum(own)}/{len(own)}, {sum(their)}/{len(their)}", "",
    )  # fmt: skip


def _geometric(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values))))


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{np.median(known):.2f}" if known else "-"
