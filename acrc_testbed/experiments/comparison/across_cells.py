"""What a declared comparison comes to over all cells of a study: conditions that might have been others."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from acrc_testbed.experiments.campaign.trial_record import TrialRecord
from acrc_testbed.experiments.comparison.comparison import StrategyRuns, runs_by_variant
from acrc_testbed.experiments.statistics.paired_tests import LEAST_PAIRS
from acrc_testbed.experiments.statistics.random_effects import FEWEST_CELLS, RandomEffectsFit, fit
from acrc_testbed.experiments.study.study import Study, Variant

_MAP: Final = "map"


class WithoutMap(NamedTuple):
    """The mean difference over the cells that have other maps."""

    map: str
    difference: float


class AcrossCells(NamedTuple):
    """Places of one strategy less those of another with the same seed, over all cells."""

    one: str
    other: str
    fitted: RandomEffectsFit | None
    """None with fewer than three cells that have runs of both, or too few pairs."""
    cells: int
    without: tuple[WithoutMap, ...] = ()
    """Without each map in turn; empty if there is but one."""

    @property
    def turning(self) -> tuple[WithoutMap, ...]:
        """Those without which the difference has the other sign, or none; empty where all has none."""
        whole = 0.0 if self.fitted is None else self.fitted.mean.value
        return tuple(one for one in self.without if whole and one.difference * whole <= 0)


class _CellDifference(NamedTuple):
    cell: int
    seed: int
    places: float
    map: str


def across_cells(records: Iterable[TrialRecord], study: Study) -> list[AcrossCells]:
    """Of every declared comparison; none of a study with fewer than three cells.

    A cell is a combination of all factors, random or not. Only estimated, never tested.
    """
    if len(study.variants()) < FEWEST_CELLS:
        return []
    runs = runs_by_variant(records, study)
    return [_across(one, other, list(_differences(one, other, runs, study)))
            for one, other in study.primary_pairs]  # fmt: skip


def _differences(
    one: str, other: str, runs: Mapping[Variant, StrategyRuns], study: Study
) -> Iterator[_CellDifference]:
    for cell, (variant, by_strategy) in enumerate(runs.items()):
        mine, theirs = by_strategy.get(one, {}), by_strategy.get(other, {})
        for seed in (seed for seed in mine if seed in theirs):
            places = float(mine[seed].places_done - theirs[seed].places_done)
            yield _CellDifference(cell, seed, places, _map(variant, study))


def _map(variant: Variant, study: Study) -> str:
    """What a study calls the map of a variant; empty if it does not vary."""
    for factor in (*study.factors, *study.random):
        for key, value in variant:
            if key == factor.key and _MAP in dict(factor.settings(value)):
                return str(value) if factor.levels else Path(str(value)).stem
    return ""


def _across(one: str, other: str, found: Sequence[_CellDifference]) -> AcrossCells:
    cells = len({each.cell for each in found})
    if cells < FEWEST_CELLS or len(found) < LEAST_PAIRS:
        return AcrossCells(one, other, None, cells)
    maps = dict.fromkeys(each.map for each in found)
    without = [
        WithoutMap(name, _mean([each for each in found if each.map != name]))
        for name in (maps if len(maps) > 1 else ())
    ]
    return AcrossCells(one, other, _fitted(found), cells, tuple(without))


def _fitted(found: Sequence[_CellDifference]) -> RandomEffectsFit:
    return fit([one.places for one in found], [one.cell for one in found], [one.seed for one in found])


def _mean(found: Sequence[_CellDifference]) -> float:
    """That of the model; of too few cells for it the mean of theirs."""
    cells = dict.fromkeys(one.cell for one in found)
    if len(cells) >= FEWEST_CELLS:
        return _fitted(found).mean.value
    return float(np.mean([np.mean([one.places for one in found if one.cell == cell]) for cell in cells]))


def told(found: AcrossCells) -> list[str]:
    """In sentences that can be quoted."""
    name = f"{found.one} less {found.other}"
    fitted = found.fitted
    if fitted is None:
        return [
            f"{name} over all cells: {found.cells} have runs of both; at least {FEWEST_CELLS} with "
            f"{LEAST_PAIRS} pairs of runs are needed before anything is said of cells."
        ]
    mean, new = fitted.mean, fitted.new_cell
    return [
        f"{name} over all {fitted.cells} cells, {fitted.values} pairs: {mean.value:+.3g} places "
        f"[{mean.low:+.3g}, {mean.high:+.3g}]; standard deviation {_spreads(fitted)}. "
        f"A new cell of this kind, with as many seeds, would show {new.low:+.3g} to {new.high:+.3g} (95 %).",
        *_faults(fitted),
        *_leaving_out(found),
    ]


def _spreads(fitted: RandomEffectsFit) -> str:
    if fitted.rest is None:
        return f"{fitted.between_cells:.3g} between cells, each of one pair, so chance of the runs is in it"
    seeds = "" if fitted.between_seeds is None else f"{fitted.between_seeds:.3g} between seeds, "
    return f"{fitted.between_cells:.3g} between cells, {seeds}{fitted.rest:.3g} of what is left"


def _faults(fitted: RandomEffectsFit) -> Iterator[str]:
    """What the model cannot tell."""
    if fitted.rest is not None and fitted.between_cells == 0.0:
        yield (
            "The fit is singular: cells differ no more than chance makes them, so the variance between them "
            f"comes to 0. {fitted.cells} cells do not show that; both intervals may be too narrow."
        )


def _leaving_out(found: AcrossCells) -> Iterator[str]:
    if not found.without:
        return
    ordered = sorted(found.without, key=lambda one: one.difference)
    least, most = ordered[0], ordered[-1]
    turns = ", ".join(f"{one.map} ({one.difference:+.3g})" for one in found.turning)
    level = found.fitted is not None and found.fitted.mean.value == 0.0
    holds = "there is no direction." if level else "the direction holds."
    yield (
        f"Without each of {len(ordered)} maps in turn: {least.difference:+.3g} (without {least.map}) to "
        f"{most.difference:+.3g} (without {most.map}); "
        + (f"the direction does not hold without {turns}." if turns else holds)
    )
