"""Floor plans from files: the YAML and image of ROS map_server (wiki.ros.org/map_server, "Map format")."""

import hashlib
import io
import math
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from actors.floor import offices
from actors.floor.drawing import RESOLUTION
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.map_header import YAML_BYTES, MapError, MapHeader, read_header
from actors.floor.sharing import Shared
from actors.geometry import GREATEST_COORDINATE, Point
from actors.runtime import regular_file

_BRIGHTNESS: Final = np.arange(3 * 255 + 1, dtype=np.float64) / 3
"""The brightness, 0 to 255, of a pixel whose red, green and blue add up to the index."""
_FORMATS: Final = ("PNG", "PPM", "BMP", "GIF", "TIFF", "WEBP", "JPEG")
_GREY_SPREAD: Final = 32
"""Difference of a pixel's channels above which it is a colour: JPEG and scanners make smaller ones."""
_YAW_TOLERANCE: Final = 0.0025
"""Tolerance of a yaw beside a multiple of π/2, rad: files have 1.57 for π/2 and 4.71 for 3π/2."""
_UNKNOWN: Final = 0.196
"""Occupancy of the grey 205 that map_saver writes for unknown, rounded down; brighter is floor."""
_POCKETS: Final = 0.01
"""Share of an image above which such grey within walls is warned of."""

_Pixels = tuple[NDArray[np.uint16], NDArray[np.bool_], list[str]]
"""(rows, columns) of red, green and blue added up, row 0 the top; which are transparent; and warnings."""


@dataclass(frozen=True)
class MapLimits:
    """How much of a map file is read at most."""

    yaml_bytes: int = YAML_BYTES
    """Size of the YAML; real ones have under 300 bytes."""
    cells: int = 16_000_000
    """Pixels of the image: 200 m by 200 m at 5 cm, about 0.5 GB while distances are computed."""
    image_bytes: int = 128_000_000
    """Size of the image's file: 8 bytes for each of so many pixels, more than any format takes."""


_MAPS: Final = Shared[OccupancyGrid]()
_WARNINGS: Final = WeakKeyDictionary[OccupancyGrid, tuple[str, ...]]()


def load_map(path: Path | str, limits: MapLimits = MapLimits()) -> OccupancyGrid:
    """Return the floor plan in the YAML file `path` and the image that it names; or a drawn one.

    "offices:7" and the like are names of floors that `actors.floor.offices` draws.

    A pixel of brightness g in 0..255, the mean of its channels, is (255 − g)/255 occupied, or g/255 with
    `negate`; with mode raw, g/100 up to 100 and unknown beyond. Above `occupied_thresh` the cell is
    occupied, below `free_thresh` free, else unknown, and so is a pixel that is not opaque. A yaw that is a
    multiple of π/2 turns the grid. Files with the same bytes give one grid, wherever they lie.
    Raises MapError, or OfficesError for such a name.
    """
    if offices.is_name(path):
        return _MAPS.get(str(path), lambda: _drawn(str(path)))
    path = Path(path)
    header = read_header(path, limits.yaml_bytes)
    try:
        image = regular_file.content(header.image, limits.image_bytes)
    except (OSError, ValueError) as error:  # a ValueError: a zero byte in its name
        raise MapError(
            f"{header.image}: the map's image cannot be read: {getattr(error, 'strerror', error)}."
        ) from error
    content = hashlib.sha256(image).digest(), replace(header, image=Path()), limits
    return _MAPS.get(content, lambda: _grid(path, header, _decoded(header.image, image, limits)))


def map_warnings(path: Path | str, limits: MapLimits = MapLimits()) -> tuple[str, ...]:
    """Return what is odd about a map that `load_map` reads, one sentence each; nothing for drawn floors.

    Raises what `load_map` raises.
    """
    grid = load_map(path, limits)
    return tuple(f"{Path(path).name}: {told}" for told in _WARNINGS.get(grid, ()))


def _drawn(name: str) -> OccupancyGrid:
    cells = np.where(offices.cells_of(name), OCCUPIED, FREE).astype(np.uint8)
    return OccupancyGrid(cells, RESOLUTION, Point(0.0, 0.0))


def _decoded(path: Path, content: bytes, limits: MapLimits) -> _Pixels:
    """The pixels of the image file `path`; of several frames the first. Raises MapError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bombs, as our own limit is lower, and of odd metadata
            with Image.open(io.BytesIO(content), formats=_FORMATS) as image:
                if image.width * image.height > limits.cells:
                    raise ValueError(f"{image.width} x {image.height} pixels are more than {limits.cells}")
                return _pixels(image)
    except UnidentifiedImageError as error:
        raise MapError(
            f"{path}: this is not an image that can be read; right are {', '.join(_FORMATS)}."
        ) from error
    except Exception as error:  # Pillow raises many kinds on damaged images
        raise MapError(f"{path}: the map's image cannot be read: {error}.") from error


def _pixels(image: Image.Image) -> _Pixels:
    told = ["JPEG blurs the edges of walls; save the image as PNG"] if image.format == "JPEG" else []
    if image.mode.startswith("I;16") or (image.mode, image.format) == ("I", "PPM"):
        wide = np.asarray(image).astype(np.int64)
        sums = ((wide + 128) // 257 * 3).astype(np.uint16)
        return sums, wide == image.info.get("transparency", -1), told
    if image.mode in {"I", "F"}:
        raise ValueError("it has 32 bits per channel, but must have 8 or 16")
    if not image.has_transparency_data and image.mode in {"1", "L"}:
        return np.multiply(np.asarray(image.convert("L")), 3, dtype=np.uint16), np.array(False), told
    channels = np.asarray(image.convert("RGBA"))
    colours, clear = channels[..., :3], channels[..., 3] < 255
    coloured = np.argwhere((np.ptp(colours, axis=2) > _GREY_SPREAD) & ~clear)
    if coloured.size:
        row, column = coloured[0]
        told.append(
            f"{len(coloured)} pixels have a colour, the first in column {column}, row {row} from the top:"
            f" {tuple(colours[row, column].tolist())}; the mean of red, green and blue counts"
        )
    return colours.sum(axis=2, dtype=np.int64).astype(np.uint16), clear, told


def _grid(path: Path, header: MapHeader, pixels: _Pixels) -> OccupancyGrid:
    sums, clear, told = pixels
    occupancy = (_BRIGHTNESS if header.negate else 255.0 - _BRIGHTNESS) / 255.0
    if header.mode == "raw":  # NaN is neither free nor occupied
        occupancy = np.where(_BRIGHTNESS <= 100, _BRIGHTNESS / 100, np.nan)
    states = np.full(occupancy.shape, UNKNOWN, dtype=np.uint8)
    states[occupancy > header.occupied] = OCCUPIED
    states[occupancy < header.free] = FREE
    cells = states[sums]
    cells[clear] = UNKNOWN
    if header.mode != "raw" and header.free > _UNKNOWN:
        told += _unknown_as_free(header, np.where(cells == FREE, sums, 0), occupancy)
    turns = round(header.yaw / (math.pi / 2))
    off = abs(header.yaw - turns * math.pi / 2)
    height, width = cells.shape[0] * header.resolution, cells.shape[1] * header.resolution
    x, y = header.origin
    if off > _YAW_TOLERANCE:
        raise MapError(
            f"{path}: origin has yaw {header.yaw:g} rad, but only multiples of 90° can be read; turn the"
            f" image by {math.degrees(header.yaw):.4g}° counter-clockwise and set yaw to 0."
        )
    if turns % 4 or off > 1e-4:
        told.append(
            f"origin has yaw {header.yaw:g}: the map is turned by {turns % 4 * 90}° counter-clockwise; AMCL"
            " and Nav2's costmaps ignore the yaw"
        )
    corners = Point(x, y), Point(x - height, y), Point(x - width, y - height), Point(x, y - width)
    grid = OccupancyGrid(np.rot90(np.flipud(cells), -turns), header.resolution, corners[turns % 4])
    if max(map(abs, (*grid.origin, *grid.corner))) > GREATEST_COORDINATE:
        raise MapError(
            f"{path}: origin ({x:.10g}, {y:.10g}) is too far from 0: coordinates of the map must be within"
            f" ±{GREATEST_COORDINATE:.0f} m; set origin to [0, 0, 0] and subtract ({x:.10g}, {y:.10g}) from"
            " coordinates that you give."
        )
    _WARNINGS[grid] = *header.warnings, *told
    return grid


def _unknown_as_free(
    header: MapHeader, floor: NDArray[np.uint16], occupancy: NDArray[np.float64]
) -> list[str]:
    """A warning if a grey that means unknown counts as free at the border, or in large pockets.

    `floor`: the sums of free pixels, 0 elsewhere.
    """
    grey = (occupancy > _UNKNOWN)[floor] & (floor > 0)
    border = bool(np.r_[grey[0], grey[-1], grey[:, 0], grey[:, -1]].any())
    count = np.count_nonzero(grey)
    if not border and count < _POCKETS * grey.size:
        return []
    level = int(np.bincount(floor[grey]).argmax())
    return [
        f"free_thresh {header.free:g} makes grey {level / 3:.0f} free floor,"
        f" {count * header.resolution * header.resolution:.3g} m² of it"
        f"{', out to the border of the image' * border}; if this grey means unknown, as map_saver's 205 does,"
        " set free_thresh to"
        f" {math.floor(1000 * occupancy[level]) / 1000:g}"
    ]
