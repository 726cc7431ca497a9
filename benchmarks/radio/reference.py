"""Reference figures of a radio simulation: folders of CSV files, one row per run, one file per family.

A family's points are the rows that agree in all settings. Where several runs made a point, its figures are
their means with standard errors; where it was one run of many frames, shares with binomial errors.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Final

from actors.runtime.errors import AcrcError

SHARES: Final = (
    "pdr_gen", "pdr_tx", "allpairs_pdr_tx", "csma_fail_ratio", "chan_busy", "overlap_tx_ratio",
)  # fmt: skip
LATENCIES: Final = ("lat_mean_ms", "lat_p95_ms")
CONTENTION: Final = (
    "b_single_saturated", "b_single_saturated_ack", "c_contention", "c_macparams", "c_contention_spatial60m",
    "d_hidden", "d_hidden_delta10dB",
)  # fmt: skip
CAPTURE: Final = ("e_capture", "e_capture_fine", "e_capture_short_interferer")
FAMILIES: Final = ("a_per", *CONTENTION, *CAPTURE)
_SETTINGS: Final = ("minbe", "maxbe", "maxnb", "n", "psdu", "load")
_CAPTURE_SETTINGS: Final = ("psdu0", "psdu1", "delta_db", "offset_us")


@dataclass(frozen=True)
class ReferenceEstimate:
    """A figure with its standard error; `freedom`: degrees of freedom of the error, inf if it is known."""

    value: float
    error: float
    freedom: float = math.inf


@dataclass(frozen=True)
class OperatingPoint:
    """One setting of a family."""

    family: str
    settings: Mapping[str, str]
    runs: int
    frames: int
    """Sent or handed over in all runs."""
    figures: Mapping[str, ReferenceEstimate]

    def __str__(self) -> str:
        """For people."""
        return f"{self.family} " + " ".join(f"{name}={value}" for name, value in self.settings.items())


def share(hits: float, of: int) -> ReferenceEstimate:
    """A share of independent trials."""
    p = hits / of
    return ReferenceEstimate(p, math.sqrt(p * (1 - p) / of))


def over_runs(values: Sequence[float]) -> ReferenceEstimate:
    """The mean of one figure over several runs."""
    if len(values) < 2:
        return ReferenceEstimate(values[0], math.inf, 1)
    return ReferenceEstimate(mean(values), stdev(values) / math.sqrt(len(values)), len(values) - 1)


def points(folder: Path, family: str) -> list[OperatingPoint]:
    """The points of a family, in the order of its file; none if there is no such file.

    AcrcError where a column is missing or is no number.
    """
    path = folder / f"{family}.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("fixed", "1") == "1"]
    try:
        if family == "a_per":
            return [_error_rate(row) for row in rows]
        if family in CAPTURE:
            return [_capture(family, row) for row in rows]
        return _contention(family, rows)
    except (KeyError, ValueError) as error:
        raise AcrcError(f"{path}: a row lacks {error}, or has no number there.") from None


def _error_rate(row: Mapping[str, str]) -> OperatingPoint:
    sent = int(row["frames_sent"])
    settings = {name: row[name] for name in ("psdu", "rx_dbm", "noise_dbm")}
    return OperatingPoint("a_per", settings, 1, sent, {"per": share(sent - int(row["frames_ok"]), sent)})


def _capture(family: str, row: Mapping[str, str]) -> OperatingPoint:
    frames = int(row["frames"])
    figures = {name: share(float(row[name]) * frames, frames) for name in ("pdr_first", "pdr_second")}
    return OperatingPoint(family, {name: row[name] for name in _CAPTURE_SETTINGS}, 1, frames, figures)


def _contention(family: str, rows: Sequence[Mapping[str, str]]) -> list[OperatingPoint]:
    groups: dict[tuple[tuple[str, str], ...], list[Mapping[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple((name, row[name]) for name in _SETTINGS if name in row), []).append(row)
    return [
        OperatingPoint(
            family,
            dict(settings),
            len(runs),
            sum(int(run["generated"]) for run in runs),
            {name: over_runs([float(run[name]) for run in runs]) for name in (*SHARES, *LATENCIES)}
            | {"goodput_kbps": over_runs([float(run["goodput_kbps"]) for run in runs])},
        )
        for settings, runs in groups.items()
    ]
