"""Comparison of the medium with reference figures of another simulator, in preset `ns3`.

For each figure of each point: the difference from our mean, and the combined standard error of both sides.
Both sides are runs of one experiment with the same length, so a pooled variance is used (two-sample Student's
t): the few reference runs often have a small variance by chance. If a point is one run of many frames, errors
are binomial. A comparison is informative if it is a latency or a share between 0.02 and 0.98; the others are
trivial. `inside`: within the combined 95 % interval. `z`: t converted to the normal score of equal
probability (Wallace, "Bounds on normal approximations to Student's and the chi-square distributions", Annals
of Mathematical Statistics 30, 1959). `welch_t`: with the variance of each side.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, make_table
from acrc_testbed.benchmarks.radio_trials import (
    FAMILIES,
    LATENCIES,
    NS3_MAC_OCTETS,
    OperatingPoint,
    ReferenceEstimate,
    measure,
    read_points,
)
from acrc_testbed.results.clock_alignment import t_quantile
from actors.console import create_console
from actors.runtime.errors import AcrcError

_FREEDOM_ENOUGH: Final = 200.0
_ROUNDING: Final = 1e-5
"""Rounding error of figures in the files."""
_FAR: Final = 99.0
"""Score of a difference whose standard error is 0."""
GOALS: Final = {"inside_goal": 0.95, "excess_goal": 0.005, "z_goal": 4.5, "throughput_goal": 0.002}
"""Minimum share of figures inside; maximum excess of a share, score, and relative throughput error."""


@dataclass(frozen=True)
class FigureComparison:
    """Comparison of one figure of one point."""

    point: str
    figure: str
    reference: float
    own: float
    error: float
    """Combined standard error."""
    z: float
    welch_t: float
    inside: bool
    informative: bool
    excess: float
    """Difference of a share minus three combined standard errors; at most 0: within."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of a family, or of all."""

    family: str
    points: int
    comparisons: int
    inside: int
    trivial: int
    worst_z: float
    worst_welch_t: float
    worst_ratio_excess: float
    worst: str
    """Point and figure of `worst_z`."""


def check(data: Path, runs: int = 10) -> BenchmarkResult:
    """Compare the medium with reference data in a folder; `runs`: our frames per reference frame."""
    console = create_console(stderr=True)
    comparisons: list[FigureComparison] = []
    agreements: list[Agreement] = []
    throughput = [0.0]
    for family in FAMILIES:
        reference_points = read_points(data, family)
        if not reference_points:
            console.print(f"{family}: skipped, {family}.csv is missing or empty.")
            continue
        found: list[FigureComparison] = []
        for point in reference_points:
            own = measure(point, runs)
            found += [
                compare(point, name, reference, own[name])
                for name, reference in point.figures.items()
                if name != "goodput_kbps"
            ]
            if family.startswith("b_"):
                throughput.append(abs(own["goodput_kbps"].value / formula_kbps(point) - 1))
        agreements.append(agreement(family, len(reference_points), found))
        comparisons += found
    if not agreements:
        raise AcrcError(f"{data}: contains none of the files {', '.join(FAMILIES)} (.csv).")
    return _result(agreements, comparisons, max(throughput), runs)


def _result(
    agreements: Sequence[Agreement], comparisons: Sequence[FigureComparison], worst: float, runs: int
) -> BenchmarkResult:
    """Check the goals; `worst`: greatest throughput error."""
    total = agreement("all", sum(one.points for one in agreements), comparisons)
    met = {
        "inside": total.inside >= GOALS["inside_goal"] * total.comparisons,
        "excess": total.worst_ratio_excess <= GOALS["excess_goal"],
        "z": total.worst_z <= GOALS["z_goal"],
        "throughput": worst <= GOALS["throughput_goal"],
    }
    figures = {
        "task": {"times": runs, **GOALS},
        "families": [asdict(one) for one in agreements],
        "all": asdict(total),
        "throughput_error": worst,
        "outside": [asdict(c) for c in comparisons if not c.inside],
        "met": met,
    }
    missed = [name for name, reached in met.items() if not reached]
    shown = (
        make_table([_row(one) for one in (*agreements, total)], "Medium and reference, preset ns3"),
        f"Worst: {total.worst}",
        f"One backlogged sender: throughput within {worst:.3%} of the formula.",
        f"Goals missed: {', '.join(missed)}." if missed else "All goals met.",
    )
    return BenchmarkResult(figures, shown, not missed)


def compare(
    point: OperatingPoint, figure: str, reference: ReferenceEstimate, own: ReferenceEstimate
) -> FigureComparison:
    """Compare one figure of both sides."""
    difference = own.value - reference.value
    error, freedom = combined_error(reference, own)
    t = _ratio(difference, error)
    latency = figure in LATENCIES
    return FigureComparison(
        point=str(point),
        figure=figure,
        reference=reference.value,
        own=own.value,
        error=error,
        z=math.copysign(normal_score(abs(t), freedom), t),
        welch_t=_ratio(difference, math.hypot(reference.error, own.error)),
        inside=abs(t) <= (t_quantile(0.975, freedom) if freedom < _FREEDOM_ENOUGH else 1.96),
        informative=latency or 0.02 < reference.value < 0.98,
        excess=-math.inf if latency else abs(difference) - 3 * error,
    )


def normal_score(t: float, freedom: float) -> float:
    """Convert t ≥ 0 to the normal score of equal probability, by Wallace's approximation."""
    if freedom >= _FREEDOM_ENOUGH:
        return t
    return (8 * freedom + 1) / (8 * freedom + 3) * math.sqrt(freedom * math.log1p(t * t / freedom))


def formula_kbps(point: OperatingPoint) -> float:
    """Return the throughput of one backlogged sender, kb/s of MSDU.

    Its period is spacing, mean back-off, CCA, turnaround and frame, plus turnaround and acknowledgement if
    used (Latré et al., "Throughput and delay analysis of unslotted IEEE 802.15.4", Journal of Networks 1(1),
    2006, with CCA and turnaround added).
    """
    octets = int(point.settings["psdu"])
    symbols = (12 if octets <= 18 else 40) + 3.5 * 20 + 8 + 12 + (12 + 2 * octets)
    if point.family.endswith("_ack"):
        symbols += 12 + 22
    return 8 * (octets - NS3_MAC_OCTETS) * 62.5 / symbols


def agreement(family: str, number: int, found: Sequence[FigureComparison]) -> Agreement:
    """Summarise the comparisons of a family."""
    informative = [comparison for comparison in found if comparison.informative]
    worst = max(informative, key=lambda comparison: abs(comparison.z), default=None)
    return Agreement(
        family=family,
        points=number,
        comparisons=len(informative),
        inside=sum(comparison.inside for comparison in informative),
        trivial=len(found) - len(informative),
        worst_z=abs(worst.z) if worst else 0.0,
        worst_welch_t=max((abs(comparison.welch_t) for comparison in informative), default=0.0),
        worst_ratio_excess=max((comparison.excess for comparison in found), default=0.0),
        worst=f"{worst.point}: {worst.figure}" if worst else "",
    )


def combined_error(one: ReferenceEstimate, other: ReferenceEstimate) -> tuple[float, float]:
    """Return the standard error of the difference of two means, and its degrees of freedom."""
    if not (math.isfinite(one.freedom) and math.isfinite(other.freedom)):
        return math.hypot(one.error, other.error), math.inf
    freedom = one.freedom + other.freedom
    spread = sum(side.freedom * (side.freedom + 1) * side.error**2 for side in (one, other))
    runs = 1 / (one.freedom + 1) + 1 / (other.freedom + 1)
    return math.sqrt(spread / freedom * runs), freedom


def _ratio(difference: float, error: float) -> float:
    if error > 0:
        return difference / error
    return 0.0 if abs(difference) <= _ROUNDING else math.copysign(_FAR, difference)


def _row(row: Agreement) -> dict[str, object]:
    share = f"{row.inside} ({row.inside / row.comparisons:.1%})" if row.comparisons else "0"
    return {
        "family": row.family, "points": row.points, "comparisons": row.comparisons, "inside": share,
        "trivial": row.trivial, "worst z": f"{row.worst_z:.2f}",
        "worst excess": f"{row.worst_ratio_excess:+.4f}",
    }  # fmt: skip
