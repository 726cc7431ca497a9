"""Comparison of the medium with reference figures of another simulator, in preset `ns3`.

For each figure of each point: the difference to the own mean, and the combined standard error of both sides.
Both sides are runs of one experiment, of the same length, so that one variance stands for both (Student's t
for two samples): the handful of the reference's runs often lie together by chance. Where a point is one run
of many frames, errors are binomial. A comparison says something if it is a latency or a share between 0.02
and 0.98; the others are trivial. `inside`: within the combined 95 % interval. `z`: t as the score of a normal
variable that is exceeded as rarely (Wallace, "Bounds on normal approximations to Student's and the chi-square
distributions", Annals of Mathematical Statistics 30, 1959). `welch_t`: with each side's own variance.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from acrc_testbed.benchmarks.measured import Measured, table_of
from acrc_testbed.benchmarks.radio_trials import (
    FAMILIES,
    LATENCIES,
    NS3_MAC_OCTETS,
    OperatingPoint,
    ReferenceEstimate,
    measure,
    points,
)
from acrc_testbed.results.clock_alignment import quantile
from actors.console import screen
from actors.runtime.errors import AcrcError

_FREEDOM_ENOUGH: Final = 200.0
_ROUNDING: Final = 1e-5
"""Rounding error of figures in the files."""
_FAR: Final = 99.0
"""As many standard errors is a difference where there should be none at all."""
GOALS: Final = {"inside_goal": 0.95, "excess_goal": 0.005, "z_goal": 4.5, "throughput_goal": 0.002}
"""Least share of figures inside; excess of a share; score; relative throughput of one backlogged sender."""


@dataclass(frozen=True)
class FigureComparison:
    """One figure of one point."""

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
    """How far the difference of a share lies beyond three combined standard errors; 0 or less: nowhere."""


@dataclass(frozen=True)
class Agreement:
    """A family, or all."""

    family: str
    points: int
    comparisons: int
    inside: int
    trivial: int
    worst_z: float
    worst_welch_t: float
    worst_ratio_excess: float
    worst: str
    """Where `worst_z` is."""


def check(data: Path, runs: int = 10) -> Measured:
    """Compare the medium with the rows in the folder, with `runs` own frames per frame of them."""
    console = screen(stderr=True)
    every: list[FigureComparison] = []
    agreements: list[Agreement] = []
    throughput = [0.0]
    for family in FAMILIES:
        there = points(data, family)
        if not there:
            console.print(f"{family}: no file {family}.csv with rows, left out.")
            continue
        found: list[FigureComparison] = []
        for point in there:
            own = measure(point, runs)
            found += [
                compare(point, name, reference, own[name])
                for name, reference in point.figures.items()
                if name != "goodput_kbps"
            ]
            if family.startswith("b_"):
                throughput.append(abs(own["goodput_kbps"].value / formula_kbps(point) - 1))
        agreements.append(agreement(family, len(there), found))
        every += found
    if not agreements:
        raise AcrcError(f"{data}: there is none of the files {', '.join(FAMILIES)}, each with .csv.")
    return _judged(agreements, every, max(throughput), runs)


def _judged(
    agreements: Sequence[Agreement], every: Sequence[FigureComparison], worst: float, runs: int
) -> Measured:
    """`worst`: throughput error."""
    total = agreement("all", sum(one.points for one in agreements), every)
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
        "outside": [asdict(c) for c in every if not c.inside],
        "met": met,
    }
    missed = [name for name, reached in met.items() if not reached]
    shown = (
        table_of([_row(one) for one in (*agreements, total)], "The medium beside the reference, preset ns3"),
        f"Worst: {total.worst}",
        f"One backlogged sender: within {worst:.3%} of the closed formula.",
        f"Goals missed: {', '.join(missed)}." if missed else "All goals met.",
    )
    return Measured(figures, shown, not missed)


def compare(
    point: OperatingPoint, figure: str, reference: ReferenceEstimate, own: ReferenceEstimate
) -> FigureComparison:
    """One figure on both sides."""
    difference = own.value - reference.value
    error, freedom = combined(reference, own)
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
        inside=abs(t) <= (quantile(0.975, freedom) if freedom < _FREEDOM_ENOUGH else 1.96),
        informative=latency or 0.02 < reference.value < 0.98,
        excess=-math.inf if latency else abs(difference) - 3 * error,
    )


def normal_score(t: float, freedom: float) -> float:
    """Return the score that a normal variable exceeds as rarely as a t variable exceeds t ≥ 0, by Wallace."""
    if freedom >= _FREEDOM_ENOUGH:
        return t
    return (8 * freedom + 1) / (8 * freedom + 3) * math.sqrt(freedom * math.log1p(t * t / freedom))


def formula_kbps(point: OperatingPoint) -> float:
    """Throughput of one backlogged sender, kb/s of MSDU: spacing, mean back-off, CCA, turnaround, frame; and
    turnaround and acknowledgement where there is one (Latré et al., "Throughput and delay analysis of
    unslotted IEEE 802.15.4", Journal of Networks 1(1), 2006, with CCA and turnaround added).
    """
    octets = int(point.settings["psdu"])
    symbols = (12 if octets <= 18 else 40) + 3.5 * 20 + 8 + 12 + (12 + 2 * octets)
    if point.family.endswith("_ack"):
        symbols += 12 + 22
    return 8 * (octets - NS3_MAC_OCTETS) * 62.5 / symbols


def agreement(family: str, number: int, found: Sequence[FigureComparison]) -> Agreement:
    """Summarise the comparisons of a family."""
    telling = [comparison for comparison in found if comparison.informative]
    worst = max(telling, key=lambda comparison: abs(comparison.z), default=None)
    return Agreement(
        family=family,
        points=number,
        comparisons=len(telling),
        inside=sum(comparison.inside for comparison in telling),
        trivial=len(found) - len(telling),
        worst_z=abs(worst.z) if worst else 0.0,
        worst_welch_t=max((abs(comparison.welch_t) for comparison in telling), default=0.0),
        worst_ratio_excess=max((comparison.excess for comparison in found), default=0.0),
        worst=f"{worst.point}: {worst.figure}" if worst else "",
    )


def combined(one: ReferenceEstimate, other: ReferenceEstimate) -> tuple[float, float]:
    """The standard error of the difference of two means, and its degrees of freedom."""
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


def _row(of: Agreement) -> dict[str, object]:
    share = f"{of.inside} ({of.inside / of.comparisons:.1%})" if of.comparisons else "0"
    return {
        "family": of.family, "points": of.points, "comparisons": of.comparisons, "inside": share,
        "trivial": of.trivial, "worst z": f"{of.worst_z:.2f}",
        "worst excess": f"{of.worst_ratio_excess:+.4f}",
    }  # fmt: skip
