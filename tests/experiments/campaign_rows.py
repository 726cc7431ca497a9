"""Rows of a real campaign to resample, with ties, ceilings and incomplete runs."""

import csv
from pathlib import Path

from acrc_testbed.experiments.comparison import PairedSample
from acrc_testbed.experiments.study import Factor, Study
from acrc_testbed.results.result import RunResult
from tests.experiments.made_runs import CLEANING, run

ROWS = Path(__file__).with_name("campaign.csv")
FACTOR = "places.per_robot"
Cell = tuple[str, int]
"""Strategy and places of each robot."""


def runs() -> dict[Cell, dict[int, RunResult]]:
    found: dict[Cell, dict[int, RunResult]] = {}
    with ROWS.open(newline="") as file:
        for row in csv.DictReader(file):
            found.setdefault((row["strategy"], int(row[f"vary.{FACTOR}"])), {})[int(row["seed"])] = run(
                int(row["places_done"]),
                places_total=int(row["places_total"]),
                completion_s=float(row["completion_s"]) if row["completion_s"] else None,
                settled=float(row["settled_s"]) if row["settled_s"] else None,
                length=float(row["simulated_s"]),
                contacts=int(row["contacts"]),
                radio_bytes_per_robot_s=float(row["radio_bytes_per_robot_s"]),
                driven_m=float(row["driven_m"]),
            )
    return found


def study(primary: tuple[tuple[str, str], ...], seeds: int) -> Study:
    cells = runs()
    strategies = tuple(dict.fromkeys(strategy for strategy, _ in cells))
    places = tuple(dict.fromkeys(count for _, count in cells))
    return Study(
        name="rows",
        task=CLEANING,
        scenario="",
        strategies=strategies,
        seeds=seeds,
        primary=primary,
        factors=(Factor(FACTOR, places),),
    )


def samples(primary: tuple[tuple[str, str], ...]) -> list[PairedSample]:
    found = runs()
    return [
        PairedSample(
            one, other, ((FACTOR, count),),
            tuple((run, found[other, count][seed]) for seed, run in found[one, count].items()),
        )
        for count in dict.fromkeys(count for _, count in found)
        for one, other in primary
    ]  # fmt: skip
