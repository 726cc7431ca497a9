"""Map files for tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.map_file import MapError, load_map
from actors.geometry import Point

YAML = {
    "image": "plan.png",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
GREYS = np.array([[0, 100, 205], [254, 255, 88]], dtype=np.uint8)


def written(directory: Path, picture: Image.Image | None = None, /, **changes: str | None) -> Path:
    (picture or Image.fromarray(GREYS)).save(directory / "plan.png")
    fields = {key: text for key, text in (YAML | changes).items() if text is not None}
    path = directory / "plan.yaml"
    path.write_text("".join(f"{key}: {text}\n" for key, text in fields.items()), encoding="utf-8")
    return path


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(MapError) as caught:
        load_map(path, **options)
    return str(caught.value).replace(f"{path.parent}/", "")


SOUTH_WEST = Point(0.0, 0.0)
STATES = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}


def plan(*lines: str, resolution: float = 1.0, origin: Point = SOUTH_WEST) -> OccupancyGrid:
    cells = np.array([[STATES[sign] for sign in line] for line in reversed(lines)], dtype=np.uint8)
    return OccupancyGrid(cells, resolution, origin)


def random_plan(seed: int, rows: int, columns: int, share_blocking: float) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    cells = np.where(
        rng.random((rows, columns)) < share_blocking, rng.integers(1, 3, (rows, columns)), FREE
    ).astype(np.uint8)
    return OccupancyGrid(cells, 0.25, Point(-3.0, 7.5))


def room(side: float, resolution: float = 0.1) -> OccupancyGrid:
    cells = np.full((round(side / resolution) + 2,) * 2, OCCUPIED, dtype=np.uint8)
    cells[1:-1, 1:-1] = FREE
    return OccupancyGrid(cells, resolution, Point(-resolution, -resolution))


_WALL: Final = 4
_DOOR: Final = 1.2
"""Width of the doors, m."""


@dataclass(frozen=True)
class PublicMap:
    """Imitation of a public map: the YAML as its tool writes it, a new drawing of equal format."""

    name: str
    """Repository and name of the map."""
    image: str
    tool: str
    """"ros1" or "nav2", whose map_saver wrote the YAML."""
    resolution_text: str
    origin: str
    size: tuple[int, int]
    """Rows and columns of the imitation."""
    rooms: tuple[int, int]
    """Number of rooms from south to north and from west to east."""
    free: str = "0.196"
    occupied: str = "0.65"
    grey: int = 205
    """Brightness around the building; 254 if the building fills the image."""
    mode: str = "L"
    """Pillow's mode of the image."""
    pillars: int = 0
    negate: bool = False
    warnings: int = 0

    @property
    def resolution(self) -> float:
        return float(self.resolution_text)

    def write(self, folder: Path) -> Path:
        pixels = self._pixels()
        picture = Image.fromarray(255 - pixels if self.negate else pixels)
        picture.convert(self.mode).save(folder / self.image)
        path = folder / "map.yaml"
        mode, end = ("mode: trinary\n", "") if self.tool == "nav2" else ("", "\n\n")
        text = (
            f"image: {self.image}\n{mode}resolution: {self.resolution_text}\norigin: [{self.origin}]\n"
            f"negate: {self.negate:d}\noccupied_thresh: {self.occupied}\nfree_thresh: {self.free}{end}"
        )
        path.write_text(text, encoding="utf-8")
        return path

    def _pixels(self) -> NDArray[np.uint8]:
        rows, columns = self.size
        pixels = np.full(self.size, self.grey, np.uint8)
        margin = 0 if self.grey == 254 else 8
        inner = pixels[margin : rows - margin, margin : columns - margin]
        inner[:] = 254
        door = round(_DOOR / self.resolution / 2)
        for axis, count in enumerate(self.rooms):
            plan = inner if axis == 0 else inner.T
            length, across = plan.shape[0] - _WALL, plan.shape[1]
            for line in range(count + 1):
                at = round(line * length / count)
                plan[at : at + _WALL] = 0
            other = self.rooms[1 - axis]
            for line in range(1, count):
                at = round(line * length / count)
                for room in range(other):
                    middle = round((room + 0.5) * across / other)
                    plan[at : at + _WALL, middle - door : middle + door] = 254
        chance = np.random.default_rng(7)
        for _ in range(self.pillars):
            row, column = chance.uniform(0.1, 0.9, 2) * inner.shape
            inner[int(row) : int(row) + 3, int(column) : int(column) + 3] = 0
        return pixels


PUBLIC_MAPS: Final = (
    PublicMap("ros-navigation/navigation2 depot", "depot.pgm", "nav2", "0.05", "0.0, 0.0, 0",
              (150, 300), (1, 3), free="0.25", warnings=1),
    PublicMap("linorobot/linorobot2 playground", "playground.pgm", "nav2", "0.05", "-10.3, -10.5, 0",
              (150, 150), (2, 2), free="0.25", warnings=1),
    PublicMap("turtlebot/turtlebot4 warehouse", "warehouse.pgm", "nav2", "0.03", "-15.1, -25, 0",
              (400, 250), (3, 1), free="0.1", pillars=12),
    PublicMap("turtlebot/turtlebot_apps willow", "willow-2010-02-18-0.10.pgm", "ros1", "0.100000",
              "0.000000, 0.000000, 0.000000", (150, 140), (2, 3)),
    PublicMap("aws-robotics/aws-robomaker-small-warehouse-world", "map_rotated.png", "ros1", "0.050000",
              "-7.000, -10.500000, 0.000000", (210, 140), (2, 1), mode="RGBA", pillars=8),
    PublicMap("f1tenth/f1tenth_gym_ros Spielberg", "Spielberg_map.png", "ros1", "0.05796",
              "-84.85359914210505,-36.30299725862132, 0.000000", (200, 200), (2, 1),
              occupied="0.45", grey=254),
    PublicMap("DFKI-NI/mir_robot maze", "maze.png", "ros1", "0.05", "0.0, 0.0, 0.0",
              (160, 160), (2, 2), grey=254, mode="RGB"),
    PublicMap("ipa320/cob_environments izs-campus", "map.pgm", "ros1", "0.250000",
              "-119.199997, -228.000000, 0.000000", (100, 120), (2, 2)),
    PublicMap("ros-navigation/navigation2 100by100", "100by100_10.pgm", "ros1", "0.050000",
              "0.000000, 0.000000, 0.000000", (200, 200), (1, 1), grey=254, negate=True, pillars=40),
)  # fmt: skip
