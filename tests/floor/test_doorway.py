"""Where doors hang: from wall to wall, and nothing gets by."""

import numpy as np
import pytest

from actors.floor import flood
from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import Cell, OccupancyGrid, passable
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.installation.repository import REPOSITORY

RADIUS = 0.177


def doorways(name: str) -> tuple[OccupancyGrid, Doorways]:
    grid = load_map(REPOSITORY / "maps" / f"{name}.yaml")
    return grid, Doorways(grid, RADIUS)


def test_a_closed_office_door_spans_its_opening() -> None:
    grid, doors = doorways("corridor")
    rows, columns = np.nonzero(doors.closed(doors.at(Point(12.45, 9.4))))
    first, last = grid.centre(Cell(rows.min(), columns.min())), grid.centre(Cell(rows.max(), columns.max()))
    assert last.y - first.y < 0.05 and (first.x, last.x) == pytest.approx((12.0, 12.88), abs=0.05)
    cells = grid.blocking[rows[0], [columns.min() - 1, columns.max() + 1]]
    assert cells.all(), "it reaches from wall to wall"


@pytest.mark.parametrize("name", ["corridor", "apartment", "maze"])
def test_a_closed_door_parts_what_it_joined(name: str) -> None:
    grid, doors = doorways(name)
    floor = passable(grid, RADIUS)
    for door in doors.regions.doors:
        left = floor & ~doors.closed(door)
        inside = doors.regions.labels == doors.regions.count + 1 + door.index
        pieces = flood.regions(left & np.isin(doors.regions.labels, door.regions) | left & inside)
        ends = [np.unique(pieces[(doors.regions.labels == one) & (pieces > 0)]) for one in door.regions]
        assert len(set(map(tuple, ends))) > 1, door


def test_a_point_beside_a_door_means_it_and_one_on_open_floor_none() -> None:
    _, doors = doorways("corridor")
    assert doors.at(Point(12.45, 9.4)) == doors.at(Point(12.6, 9.9))
    with pytest.raises(DoorError) as caught:
        doors.at(Point(9.0, 12.5))
    assert str(caught.value).startswith(
        "(9, 12.5) is in no door of the map; its doors are at (12.52, 9.48), "
    )
