"""How like two floor plans are: free area, and what the reachable floor of both has in common."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from actors.floor.grid import OccupancyGrid, reachable
from actors.floor.map_file import MapError, load_map
from actors.geometry import Point

CORRIDOR: Final = Point(15.0, 11.0)
"""A point of the corridor of the original testbed, m."""


@dataclass(frozen=True)
class Likeness:
    """What two floor plans have in common, counting only the floor reachable from one point."""

    area: float
    """Reachable floor of the first map, m²."""
    reference_area: float
    """Reachable floor of the other map, m²."""
    overlap: float
    """Intersection over union of both, in 0..1."""


def run(against: Path, map_file: Path, json_output: bool = False, start: Point = CORRIDOR) -> None:
    """Print how like the map `map_file` and the one in the directory `against` are.

    `start` is a free point of both, from which their floors are walked. Raises MapError.
    """
    reference_file = map_in(against)
    likeness = compare(_floor(map_file, start), _floor(reference_file, start))
    console = Console()
    if json_output:
        console.print_json(json.dumps(asdict(likeness)))
        return
    table = Table("floor reachable from", f"({start.x:g}, {start.y:g})")
    table.add_row(str(map_file), f"{likeness.area:.2f} m²")
    table.add_row(str(reference_file), f"{likeness.reference_area:.2f} m²")
    table.add_row("intersection over union", f"{likeness.overlap:.4f}")
    console.print(table)


def map_in(directory: Path) -> Path:
    """The one YAML file of a directory. Raises MapError."""
    found = sorted(directory.glob("*.yaml"))
    if len(found) != 1:
        names = ", ".join(file.name for file in found) or "none"
        raise MapError(f"{directory}: a directory with exactly one *.yaml is needed, but this has {names}.")
    return found[0]


def compare(floor: "PlanFigures", reference: "PlanFigures") -> Likeness:
    """The likeness of two floors, both sampled at the centres of the finer grid laid over both."""
    resolution = min(floor.grid.resolution, reference.grid.resolution)
    corners = [corner for f in (floor, reference) for corner in (f.grid.origin, f.grid.corner)]
    x = np.arange(min(c.x for c in corners) + resolution / 2, max(c.x for c in corners), resolution)
    y = np.arange(min(c.y for c in corners) + resolution / 2, max(c.y for c in corners), resolution)
    one, other = floor.sample(x, y), reference.sample(x, y)
    union = int((one | other).sum())
    return Likeness(floor.area, reference.area, int((one & other).sum()) / union)


@dataclass(frozen=True)
class PlanFigures:
    """The part of a map that is reachable."""

    grid: OccupancyGrid
    region: NDArray[np.bool_]

    @property
    def area(self) -> float:
        """m²."""
        return int(self.region.sum()) * self.grid.resolution**2

    def sample(self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """(y.size, x.size): which of the points at the given columns and rows lie on this floor."""
        column = np.floor((x - self.grid.origin.x) / self.grid.resolution).astype(np.int64)
        row = np.floor((y - self.grid.origin.y) / self.grid.resolution).astype(np.int64)
        known = np.ix_((row >= 0) & (row < self.grid.rows), (column >= 0) & (column < self.grid.columns))
        sampled = np.zeros((y.size, x.size), dtype=np.bool_)
        sampled[known] = self.region[
            row.clip(0, self.grid.rows - 1)[known[0]], column.clip(0, self.grid.columns - 1)[known[1]]
        ]
        return sampled


def _floor(file: Path, start: Point) -> PlanFigures:
    grid = load_map(file)
    region = reachable(grid, start)
    if not region.any():
        raise MapError(f"{file}: the point ({start.x:g}, {start.y:g}) is not free; start from one that is.")
    return PlanFigures(grid, region)
