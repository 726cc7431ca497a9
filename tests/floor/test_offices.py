"""Generated office floors and their names."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from actors.floor import offices
from actors.floor.doors import Doorways
from actors.floor.grid import OccupancyGrid, largest_region, outline, passable
from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.geometry import Door, Point
from tests.refusals import refused

RADIUS = 0.177
"""Radius of a TurtleBot 2, m."""
BODY = RADIUS + 0.03
"""Distance of planned paths from walls, m."""
SEEDS = 80
SEED = "but must be a whole number from 0 to 9223372036854775807, as in 'offices:7'"
DOOR = "but must be a multiple of 0.05 m from 0.9 to 1.3 m"
KEYS = "the parameters are count, door_width, corridor_width, furniture"
FIRST = "b370e236"
"""Begin of the SHA-256 of the first 20 floors' images, equal on all processors."""


@pytest.mark.parametrize("fixed", ["", ",count=20,door_width=1.30,corridor_width=1.80,furniture=2"])
def test_all_rooms_are_reachable_and_all_doors_are_found(fixed: str) -> None:
    for seed in range(SEEDS if not fixed else 8):
        name = f"{offices.PREFIX}{seed}{fixed}"
        floor, grid = offices.office_floor(name), load_map(name)
        assert np.array_equal(largest_region(grid, BODY), passable(grid, BODY)), name
        doorways = Doorways(grid, RADIUS)
        parts = doorways.regions
        assert parts.count == len(floor.rooms), f"{name}: a region for each room"
        found = [doorways.at(middle) for middle in floor.doors]
        assert sorted(door.index for door in found) == list(range(len(parts.doors))), name
        joined = {frozenset(_rooms(middle, floor.rooms)) for middle in floor.doors}
        assert {_joined(grid, parts.labels, floor.rooms, door) for door in found} == joined, name
        office_names = {room.name for room in floor.rooms[1:]}
        assert {name for pair in joined if "corridor" in pair for name in pair} == {*office_names, "corridor"}


def test_doors_can_be_closed_and_the_walls_simulated() -> None:
    for seed in range(4):
        name = f"{offices.PREFIX}{seed}"
        doorways, grid = Doorways(load_map(name), RADIUS), load_map(name)
        assert all(doorways.closed_cells(door).any() for door in doorways.regions.doors)
        assert len(outline(grid)) < 1000
        edge = np.ones_like(grid.free)
        edge[2:-2, 2:-2] = False
        assert not grid.free[edge].any(), "a wall all round"


def test_fixed_parameters_hold_and_others_vary() -> None:
    rooms, widths, doors = set(), set(), set()
    for seed in range(60):
        floor = offices.office_floor(f"{offices.PREFIX}{seed}")
        rooms.add(len(floor.rooms) - 1)
        widths.add(round((floor.rooms[0].y1 - floor.rooms[0].y0) / 0.05))
        doors |= {_door_width(f"{offices.PREFIX}{seed}", middle) for middle in floor.doors}
        fixed = f"{offices.PREFIX}{seed},count=6,door_width=1.00,corridor_width=2.20,furniture=0"
        floor = offices.office_floor(fixed)
        assert len(floor.rooms) == 7 and round((floor.rooms[0].y1 - floor.rooms[0].y0) / 0.05) == 44
        assert {_door_width(fixed, middle) for middle in floor.doors} == {20}
        assert not floor.floor.furniture
        assert len({room.surface for room in floor.rooms[1:]}) > 2, "offices differ in size"
    assert rooms == set(range(4, 11)) and widths <= set(range(36, 53)) and len(widths) > 10
    assert doors == set(range(18, 27))


def test_fixing_a_parameter_does_not_change_others() -> None:
    for seed in range(10):
        free = offices.office_floor(f"{offices.PREFIX}{seed}")
        doors = offices.office_floor(f"{offices.PREFIX}{seed},door_width=1.0")
        bare = offices.office_floor(f"{offices.PREFIX}{seed},furniture=0")
        assert free.rooms == doors.rooms == bare.rooms
        assert free.floor.furniture == doors.floor.furniture
        assert free.doors == bare.doors and len(free.doors) == len(doors.doors)


def test_a_name_means_the_same_bytes_everywhere(tmp_path: Path) -> None:
    told = hashlib.sha256()
    for seed in range(20):
        offices.write(f"{offices.PREFIX}{seed}", tmp_path / "map")
        told.update((tmp_path / "map.pbm").read_bytes())
        written, drawn = load_map(tmp_path / "map.yaml"), load_map(f"{offices.PREFIX}{seed}")
        assert np.array_equal(written.cells, drawn.cells)
        assert (written.resolution, written.origin) == (drawn.resolution, drawn.origin)
    assert told.hexdigest()[:8] == FIRST


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("offices:x", f"the seed is 'x', {SEED}"),
        ("offices:", f"the seed is '', {SEED}"),
        ("offices:7,door_width=0.5", f"door_width is '0.5', {DOOR}"),
        ("offices:7,door_width=1.02", f"door_width is '1.02', {DOOR}"),
        ("offices:7,door_width=nan", f"door_width is 'nan', {DOOR}"),
        ("offices:7,count=50", "count is '50', but must be a whole number from 1 to 20"),
        ("offices:7,count=1e999", "count is '1e999', but must be a whole number from 1 to 20"),
        ("offices:7,count", "count is '', but must be a whole number from 1 to 20"),
        ("offices:7,furniture=1,furniture=2", f"'furniture' is given twice; {KEYS}"),
        ("offices:7,doors=1", f"'doors' is not a parameter; {KEYS}"),
    ],
)  # fmt: skip
def test_invalid_names_are_refused(name: str, sentence: str) -> None:
    with refused(f"{name!r}: {sentence}", offices.OfficesError):
        load_map(name)


def test_names_are_canonical_and_limited() -> None:
    told = offices.parse("offices:07,furniture=1,door_width=1").name
    assert told == "offices:7,door_width=1.00,furniture=1" == offices.parse(told).name
    with pytest.raises(offices.OfficesError, match=r"^the floor name has 100008 characters"):
        load_map(offices.PREFIX + "7" * 100_000)


def _rooms(middle: Point, rooms: tuple[Area, ...]) -> list[str]:
    near = 0.3
    return [
        room.name
        for room in rooms
        if room.x0 - near < middle.x < room.x1 + near and room.y0 - near < middle.y < room.y1 + near
    ]


def _joined(
    grid: OccupancyGrid,
    labels: np.ndarray[tuple[int, ...], np.dtype[np.int32]],
    rooms: tuple[Area, ...],
    door: Door,
) -> frozenset[str]:
    middles = {
        int(labels[grid.cell(Point((room.x0 + room.x1) / 2, (room.y0 + room.y1) / 2))]): room.name
        for room in rooms
    }
    return frozenset(middles[region] for region in door.regions)


def _door_width(name: str, middle: Point) -> int:
    free = load_map(name).free
    row, column = load_map(name).cell(middle)
    runs = []
    for line, at in ((free[row], column), (free[:, column], row)):
        blocked = np.flatnonzero(~line)
        begin = int(np.searchsorted(blocked, at))
        runs.append(int(blocked[begin] - blocked[begin - 1] - 1))
    return min(runs)
