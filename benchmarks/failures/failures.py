"""How often the chapter's three failures come about, over many seeds, with 95 % intervals."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import median
from typing import Final

from rich.table import Table

from actors.console import screen
from actors.installation.repository import SHIPPED
from benchmarks.failures.run import FailureRun, FailureTask, examine
from benchmarks.statistics.measured import ConfidenceInterval, Measured, average, proportion
from benchmarks.statistics.runs import in_order

SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"
ROBOTS: Final = (4, 8)
BESIDE: Final = 1.0
"""Another robot within this distance is what stood in the way, m, centre to centre; own choice: where the
chapter's local planner looks, sim_time * speed = 1.5 m, less half a second."""
Count = Callable[[FailureRun], float]


def check(
    scenario: Path = SCENARIO,
    robots: Sequence[int] = ROBOTS,
    runs: int = 20,
    *,
    strategy: str = "none",
    duration: float | None = None,
    localisation: str | None = None,
    navigation: str | None = None,
    workers: int | None = None,
) -> Measured:
    """Run a scenario from each of the seeds 1 to `runs`, and count what came about.

    `duration`: simulated s of each run; None: as in the scenario. `localisation` and `navigation`: names of
    presets in place of the scenario's tables. `workers`: processes; None: one per processor. It holds where
    robots block one another or find no trajectory, and none is lost.
    """
    console = screen(stderr=True)
    found: list[FailureRun] = []
    for count in robots:
        console.print(f"strategy {strategy}, robots {count}, seeds 1 to {runs} …")
        first = FailureTask(scenario, strategy, count, 1, duration, localisation, navigation)
        tasks = [replace(first, seed=seed) for seed in range(1, runs + 1)]
        found += in_order(examine, tasks, workers)
    shown: list[Table | str] = []
    for count in robots:
        of_count = [one for one in found if one.robots == count]
        shown += [_table(strategy, of_count), *_sentences(of_count)]
    some = any(one.blockings or one.spells for one in found)
    return Measured([asdict(one) for one in found], shown, some and not any(one.lost for one in found))


def _table(strategy: str, runs: Sequence[FailureRun]) -> Table:
    first = runs[0]
    different = len({one.motion for one in runs})
    title = f"strategy {strategy}, robots {first.robots}, {len(runs)} seeds, {different} different"
    table = Table("", "runs with it", "95 %", "per run", "95 %", title=title)
    for name, count in _COUNTS.items():
        if name in _SPELLS and any(one.spells is None for one in runs):
            table.add_row(name, *("not told",) * 4)
            continue
        values = [count(one) for one in runs]
        share, mean = proportion(sum(value > 0 for value in values), len(values)), average(values)
        mean = mean._replace(low=max(mean.low, 0.0))  # counts are never below 0
        table.add_row(
            name, f"{share.value:.0%}", _span(share, ".0%"), f"{mean.value:.2f}", _span(mean, ".2f")
        )
    return table


def _span(interval: ConfidenceInterval, form: str) -> str:
    return f"{interval.low:{form}} to {interval.high:{form}}"


def _blockings(one: FailureRun, *, at_end: bool | None = None) -> int:
    return sum(at_end is None or blocking.at_end == at_end for blocking in one.blockings)


def _blocked_s(one: FailureRun, *, passage: bool | None = None) -> float:
    return sum(
        (blocking.end_s - blocking.begin_s) * len(blocking.robots)
        for blocking in one.blockings
        if passage is None or blocking.passage == passage
    )


def _door_share(one: FailureRun) -> float:
    """Of the robots' blocked time, that in doors and passages; 0 if there was none."""
    return _blocked_s(one, passage=True) / max(_blocked_s(one), 1e-9)


def _resolved(one: FailureRun) -> int:
    return sum(spell.resolved for spell in one.spells or ())


def _resolved_beside(one: FailureRun) -> int:
    """Those with another robot within BESIDE."""
    return sum(
        spell.resolved and spell.nearest is not None and spell.nearest <= BESIDE for spell in one.spells or ()
    )


_COUNTS: Final[dict[str, Count]] = {
    "robots lost: episodes": lambda one: len(one.lost),
    "  % of the robots' time": lambda one: 100 * (one.lost_share or 0.0),
    "  robots lost at the end": lambda one: one.lost_at_end,
    "no valid trajectory, resolved by itself": _resolved,
    "  with another robot within 1 m": _resolved_beside,
    "mutual blocking: episodes": _blockings,
    "  in doors and passages": lambda one: sum(blocking.passage for blocking in one.blockings),
    "  % of the blocked time in doors and passages": lambda one: 100 * _door_share(one),
    "  resolved": lambda one: _blockings(one, at_end=False),
    "  lasting to the end": lambda one: _blockings(one, at_end=True),
    "  robots in one at the end": lambda one: one.blocked_at_end,
    "  if they may move by 0.5 m: episodes": lambda one: len(one.restless_blockings),
    "  if they may: lasting to the end": lambda one: sum(b.at_end for b in one.restless_blockings),
    "goals aborted": lambda one: sum(one.aborted.values()),
    "places left": lambda one: one.left,
    "contacts": lambda one: one.contacts,
}
_SPELLS: Final = frozenset({"no valid trajectory, resolved by itself", "  with another robot within 1 m"})


def _sentences(runs: Sequence[FailureRun]) -> Iterator[str]:
    aborted: Counter[str] = Counter()
    for one in runs:
        aborted.update(one.aborted)
    reasons = ", ".join(f"{count} for {reason}" for reason, count in sorted(aborted.items())) or "none"
    goals, left = sum(one.goals for one in runs), sum(one.left for one in runs)
    yield f"goals: {goals} given, aborted {reasons}; places left: {left} of {sum(one.places for one in runs)}"
    if spells := [spell for one in runs for spell in one.spells or ()]:
        ended = Counter(spell.ended_by for spell in spells)
        lasted = median(spell.end_s - spell.begin_s for spell in spells)
        how = ", ".join(f"{count} by {by}" for by, count in sorted(ended.items()))
        unlisted = sum(one.spells_unlisted for one in runs)
        yield (
            f"no valid trajectory: {len(spells)} spells ({unlisted} more unlisted), ended {how};"
            f" median {lasted:.1f} s"
        )
    if blockings := [blocking for one in runs for blocking in one.blockings]:
        lasted = median(blocking.end_s - blocking.begin_s for blocking in blockings)
        most = max(len(blocking.robots) for blocking in blockings)
        yield f"mutual blocking: median {lasted:.0f} s, at most {most} robots"
        doors = sum(blocking.passage for blocking in blockings)
        share = sum(_blocked_s(one, passage=True) for one in runs) / sum(map(_blocked_s, runs))
        yield f"in doors and passages: {doors} of {len(blockings)} blockings, {share:.0%} of the blocked time"
