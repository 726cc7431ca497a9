"""What adaptation costs: the radio, and what else can be counted."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from experiments.report import charts, quantities
from experiments.report.cases import Case, Outcome
from experiments.report.charts import Box, Dot
from experiments.report.numbers import Cell, spread
from experiments.report.section import SPREAD, Group, Picture, ReportView, Section, medians, spread_cells
from experiments.statistics.effect_size import Interval, mean_interval


@dataclass(frozen=True)
class Cost:
    """One number of a run."""

    says: str
    """What it is, with its unit."""
    of: Callable[[Case], float | None]
    """None: unknown."""


def _of_outcome(value: Callable[[Outcome], float | None]) -> Callable[[Case], float | None]:
    return lambda case: None if case.outcome is None else value(case.outcome)


def _freed(case: Case) -> float | None:
    """Mean time for which robots had stood that got on after a decision of the adaptation, s."""
    if case.time is None:
        return None
    told = [(one.blocked_s, one.free_after_s) for one in case.time.decisions]
    times = [blocked + after for blocked, after in told if after is not None]
    return sum(times) / len(times) if times else None


def _decisions(case: Case) -> float | None:
    return None if case.time is None else float(len(case.time.decisions) + case.time.decisions_left_out)


def _adoptions(case: Case) -> float | None:
    """Return how many decisions took a place over; None if decisions are unknown or not all listed."""
    if (
        case.time is None
        or case.time.decisions_left_out
        or not (case.outcome and case.outcome.deeco.counters)
    ):
        return None
    return float(sum(one.adopts for one in case.time.decisions))


COSTS: Final = (
    Cost("octets on the air per robot and s", _of_outcome(quantities.octets)),
    Cost("air time of a robot, % of the time", _of_outcome(quantities.airtime_percent)),
    Cost("adoptions in a run", _adoptions),
    Cost("decisions of the adaptation in a run", _decisions),
    Cost("from blocked to free, s", _freed),
    Cost("CPU, ms per robot and simulated s", _of_outcome(quantities.cpu_ms)),
    Cost("metres driven by all robots", _of_outcome(quantities.driven_m)),
    Cost("contacts in a run", _of_outcome(quantities.contacts)),
    Cost("age of what robots know of one another, s", _of_outcome(quantities.age_s)),
)


def _own(name: str) -> Cost:
    """Return a number of a strategy's own outcome."""
    return Cost(f"outcome.{name}", _of_outcome(lambda run: quantities.own_means(run).get(name)))


def radio(view: ReportView) -> Section:
    """How much robots send, and what becomes of it."""

    def found(group: Group) -> tuple[float, ...]:
        return tuple(map(quantities.octets, group.outcomes))

    return Section(
        "Radio load",
        ("Octets of the frames that robots send, with MAC header and check sequence.",),
        Picture(
            "radio",
            charts.boxes(
                view.panels(lambda group: Box(group.label, view.look(group), spread(found(group)))),
                "octets on the air per robot and s", near=True,
            ),
            medians(view, "radio load", " octets/s", lambda group: spread(found(group))),
            "Octets on the air per robot and second.",
        ),
        (
            view.table(
                "radio", "Octets on the air per robot and s", SPREAD,
                lambda group: [spread_cells(spread(found(group)))],
            ),
            view.table(
                "frames", "What became of frames, and of their copies at the other robots: mean of a run",
                ("what", "number"), _frames, folded=True,
            ),
        ),
    )  # fmt: skip


def _frames(group: Group) -> list[tuple[Cell, ...]]:
    counts = [one.frames for one in group.outcomes]
    means = {name: sum(one.get(name, 0) for one in counts) / len(counts) for one in counts for name in one}
    return [(name.replace("_", " "), mean) for name, mean in means.items() if mean]


def costs(view: ReportView) -> Section:
    """Every cost that is known of some run, side by side."""
    own = dict.fromkeys(
        name for group in view.groups for one in group.outcomes for name in quantities.own_means(one)
    )
    known = [cost for cost in (*COSTS, *map(_own, own)) if any(_values(group, cost) for group in view.groups)]
    drawn = [cost for cost in known if any(any(_values(group, cost)) for group in view.groups)]
    dots = {
        cost.says: [
            Dot(view.row_name(group), view.look(group), _mean(_values(group, cost))) for group in view.groups
        ]
        for cost in drawn
    }
    text = [
        "Means over runs with Student's 95 % intervals. An adoption is a decision to take over what another "
        "robot had to do. CPU is that of the whole simulation: physics, scans and navigation are in it.",
    ]
    zero = [cost.says for cost in known if cost not in drawn]
    if zero:
        text.append(f"Zero in every run: {'; '.join(zero)}.")
    if own:
        text.append(
            "outcome.NAME is what the strategy's own outcome() returned, the mean over robots; unchecked."
        )
    missing = [cost.says for cost in COSTS if cost not in known]
    if missing:
        text.append(f"Not recorded in these runs: {'; '.join(missing)}.")
    return Section(
        "What adaptation costs",
        tuple(text),
        Picture(
            "cost",
            charts.dots(dots),
            f"Means with intervals, a panel for each of: {'; '.join(dots)}. "
            "All numbers are in the table below.",
            "Means over runs with 95 % intervals; each panel has an axis of its own, from zero.",
        ),
        (
            view.table(
                "cost", "Means over runs, with 95 % intervals", [cost.says for cost in known],
                lambda group: [[_mean(_values(group, cost)) for cost in known]],
            ),
        ),
    )  # fmt: skip


def _values(group: Group, cost: Cost) -> list[float]:
    return [value for case in group.cases if (value := cost.of(case)) is not None]


def _mean(values: list[float]) -> Interval | None:
    return mean_interval(values) if values else None
