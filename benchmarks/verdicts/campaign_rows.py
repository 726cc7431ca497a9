"""Rows of a campaign that was really run, for drawing others from: ties, ceilings, runs that never end."""

import csv
from pathlib import Path
from typing import Final

from experiments.comparison.comparison import PairedSample
from experiments.comparison.metrics import JudgedRun
from experiments.study.study import Factor, Study

ROWS: Final = Path(__file__).with_name("campaign.csv")
"""Of the campaign of the study beside it, made with `acrc campaign`: what a verdict needs of each run."""
FACTOR: Final = "places.per_robot"
Cell = tuple[str, str]
"""Strategy, and places of each robot."""


def rows() -> list[dict[str, str]]:
    """As they are in the file."""
    with ROWS.open(newline="") as file:
        return list(csv.DictReader(file))


def runs() -> dict[Cell, dict[int, JudgedRun]]:
    """By strategy and places of each robot, those of each seed."""
    found: dict[Cell, dict[int, JudgedRun]] = {}
    for row in rows():
        cell = row["strategy"], row[f"vary.{FACTOR}"]
        found.setdefault(cell, {})[int(row["seed"])] = JudgedRun(
            places_done=int(row["places_done"]),
            places_total=int(row["places_total"]),
            completion_s=_time(row["completion_s"]),
            settled_s=_time(row["settled_s"]),
            simulated_s=float(row["simulated_s"]),
            contacts=float(row["contacts"]),
            radio=float(row["radio_bytes_per_robot_s"]),
            driven_m=float(row["driven_m"]),
        )
    return found


def _time(text: str) -> float | None:
    return float(text) if text else None


def study(primary: tuple[tuple[str, str], ...], seeds: int) -> Study:
    """The study of the rows with these comparisons declared."""
    found = runs()
    strategies = tuple(dict.fromkeys(strategy for strategy, _ in found))
    places = tuple(dict.fromkeys(int(count) for _, count in found))
    return Study("rows", "", strategies, seeds, primary=primary, factors=(Factor(FACTOR, places),))


def samples(primary: tuple[tuple[str, str], ...]) -> list[PairedSample]:
    """The declared comparisons, in the order in which a campaign has them."""
    found = runs()
    counts = dict.fromkeys(count for _, count in found)
    return [
        PairedSample(
            one, other, ((FACTOR, int(count)),),
            tuple((run, found[other, count][seed]) for seed, run in found[one, count].items()),
        )
        for count in counts
        for one, other in primary
    ]  # fmt: skip
