"""Runs built from columns, for tests of their analysis."""

from pathlib import Path
from typing import Any

import numpy as np

from acrc_testbed.run_model.data import RunData, RunDescription, step_columns
from actors.floor.grid import FREE, OccupancyGrid
from actors.instant import in_seconds
from cleaning.task import CleaningTask

NO_FLOOR = OccupancyGrid(np.full((1, 1), FREE, np.uint8), 1.0)


def run_data(
    robots: tuple[str, ...], step_us: int, grid: OccupancyGrid = NO_FLOOR, **columns: Any
) -> RunData:
    """Return a run with ground truth: `true` and other columns by step and robot."""
    steps = len(columns["true"])
    description = RunDescription(
        out=Path(),
        title="a run",
        robots=robots,
        grid=grid,
        step_us=step_us,
        task=CleaningTask.declaration,
        item_counts={},
    )
    known = {"powered": columns.get("stepping", False), **columns}
    return RunData(
        description=description,
        end=in_seconds(steps * step_us),
        seconds=np.arange(0, steps * step_us, step_us) / 1e6,
        **step_columns(steps, len(robots)) | known,
    )
