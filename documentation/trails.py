"""Where the robots of a run went, as a picture: `python -m documentation.trails runs/NAME picture.svg`."""

import csv
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import TRUTH, Truth
from actors.observer.appearance import PALETTE, Appearance
from actors.runtime.codec import decode
from actors.runtime.recording import Entry, read_recording
from actors.topic import Message, Topic
from actors.world.world_setup import WorldSetup

_SCALE: Final = 40
"""Pixels per metre."""
_MARGIN: Final = 1.5
"""Metres of floor around all that happened."""
_PLACE: Final = 0.14
"""Half the side of a place's square, m."""


class Picture:
    """A part of a floor from above, in pixels; north is up."""

    def __init__(self, points: Sequence[Point]) -> None:
        self._west = min(point.x for point in points) - _MARGIN
        self._north = max(point.y for point in points) + _MARGIN
        self.width = round((max(point.x for point in points) + _MARGIN - self._west) * _SCALE)
        self.height = round((self._north - min(point.y for point in points) + _MARGIN) * _SCALE)

    def x(self, metres: float) -> float:
        """Where that is from the left."""
        return round((metres - self._west) * _SCALE, 1)

    def y(self, metres: float) -> float:
        """Where that is from the top."""
        return round((self._north - metres) * _SCALE, 1)

    def text(self, parts: Sequence[str]) -> str:
        """An SVG file."""
        size = f'viewBox="0 0 {self.width} {self.height}" width="{self.width}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
        return "\n".join([head, '<rect width="100%" height="100%" fill="#ffffff"/>', *parts, "</svg>\n"])


def draw(out: Path) -> str:
    """The run in the folder `out` as SVG: walls, places (filled once visited), each robot's start and way."""
    setup = msgspec.json.decode((out / "world" / "setup.json").read_bytes(), type=WorldSetup)
    trails = _trails(out / "radio" / "radio.mcap")
    places = [(one.id, Point(*place)) for one in setup.robots for place in one.places]
    picture = Picture(
        [*(place for _, place in places), *(point for trail in trails.values() for point in trail)]
    )
    colours = {
        name: "#{:02x}{:02x}{:02x}".format(*PALETTE[at % len(PALETTE)]) for at, name in enumerate(trails)
    }
    with (out / "places.csv").open(encoding="ascii", newline="") as file:
        done = [row["verdict"] == "done" for row in csv.DictReader(file)]
    parts = [_walls(picture, load_map(setup.map))]
    parts += [
        _square(picture, place, colours[owner], full)
        for (owner, place), full in zip(places, done, strict=True)
    ]
    parts += [line for name, trail in trails.items() for line in _way(picture, name, trail, colours[name])]
    return picture.text(parts)


def _trails(recording: Path) -> dict[str, list[Point]]:
    """Where each robot was, in the ground truth that the radio is told."""
    spacing = Appearance().trail_spacing
    found: dict[str, list[Point]] = {}
    for entry in read_recording(recording):
        if not isinstance(entry, Entry) or entry.key != TRUTH.pattern or entry.payload is None:
            continue
        truth = decode(cast(Topic[Message], TRUTH), entry.key, entry.payload)
        assert isinstance(truth, Truth)
        for robot in truth.robots:
            trail, here = found.setdefault(robot.id, []), Point(robot.x, robot.y)
            if not trail or trail[-1].distance_to(here) >= spacing:
                trail.append(here)
    return found


def _walls(picture: Picture, grid: OccupancyGrid) -> str:
    """All occupied cells that show, each run of them in a row as a rectangle of one path."""
    path = []
    side = grid.resolution * _SCALE
    for row in range(grid.rows):
        north = picture.y(grid.origin.y + (row + 1) * grid.resolution)
        if not -side < north < picture.height:
            continue
        for first, end in _runs(grid.cells[row] == OCCUPIED):
            west = picture.x(grid.origin.x + first * grid.resolution)
            width = round((end - first) * side, 2)
            if -width < west < picture.width:
                path.append(f"M{west:g} {north:g}h{width:g}v{side:g}h-{width:g}z")
    return f'<path fill="#333333" stroke="#333333" stroke-width="0.8" d="{"".join(path)}"/>'


def _runs(cells: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First index and the one behind the last of each run of what is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], cells.astype(np.int8), [0]))))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _square(picture: Picture, place: Point, colour: str, full: bool) -> str:
    side = 2 * _PLACE * _SCALE
    return (
        f'<rect x="{picture.x(place.x - _PLACE)}" y="{picture.y(place.y + _PLACE)}" width="{side:.1f}" '
        f'height="{side:.1f}" stroke="{colour}" stroke-width="2" fill="{colour if full else "#ffffff"}"/>'
    )


def _way(picture: Picture, name: str, trail: Sequence[Point], colour: str) -> Iterator[str]:
    points = " ".join(f"{picture.x(point.x)},{picture.y(point.y)}" for point in trail)
    first, last = trail[0], trail[-1]
    radius = Appearance().robot_radius * _SCALE
    yield f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>'
    yield f'<circle cx="{picture.x(first.x)}" cy="{picture.y(first.y)}" r="4" fill="{colour}"/>'
    yield (
        f'<circle cx="{picture.x(last.x)}" cy="{picture.y(last.y)}" r="{radius:.1f}" fill="#ffffff" '
        f'fill-opacity="0.7" stroke="{colour}" stroke-width="2"/>'
    )
    yield (
        f'<text x="{picture.x(last.x)}" y="{picture.y(last.y) + 4}" text-anchor="middle" '
        f'font-family="sans-serif" font-size="11" fill="{colour}">{name}</text>'
    )


def main(words: Sequence[str]) -> int:
    """Draw the run in the first folder into the file that is named second."""
    if len(words) != 2:
        sys.stderr.write("usage: python -m documentation.trails RUN PICTURE.svg\n")
        return 2
    Path(words[1]).write_text(draw(Path(words[0])), encoding="ascii")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
