"""Floor plans from files: YAML and image of ROS map_server (wiki.ros.org/map_server, "Map format")."""

import hashlib
import io
import math
import os
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PureWindowsPath
from typing import Final
from weakref import WeakKeyDictionary

import msgspec
import numpy as np
import yaml
from msgspec.structs import replace
from PIL import Image, UnidentifiedImageError

from actors.array_types import Flags, Floats, UInt16s
from actors.floor import offices
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, SharedCache
from actors.floor.offices import RESOLUTION
from actors.geometry import GREATEST_COORDINATE, Point
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.wording import short_repr

REQUIRED: Final = ("image", "resolution", "origin")
DEFAULTS: Final = {"negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196", "mode": "trinary"}
"""Defaults of optional keys. The thresholds are those of map_saver in ROS 1 and Nav2 for mode trinary."""
KEYS: Final = (*REQUIRED, *DEFAULTS)
YAML_BYTES: Final = 65_536
_BOOLEANS: Final = yaml.SafeLoader.bool_values | {"0": False, "1": True}


class MapError(AcrcError):
    """A map file that cannot be used."""


class MapHeader(msgspec.Struct, frozen=True):
    """Validated content of the YAML."""

    image: Path
    resolution: float
    origin: Point
    yaw: float
    """Rotation of the image about `origin`, counter-clockwise, rad."""
    negate: bool
    occupied: float
    free: float
    mode: str
    """One of trinary, scale and raw."""
    warnings: tuple[str, ...]

    def text(self, image: str) -> str:
        """Return the YAML of this map for another image file."""
        return (
            f"image: {image}\nmode: {self.mode}\nresolution: {self.resolution}\n"
            f"origin: [{self.origin.x}, {self.origin.y}, {self.yaw}]\nnegate: {self.negate:d}\n"
            f"occupied_thresh: {self.occupied}\nfree_thresh: {self.free}\n"
        )


def read_header(path: Path, max_bytes: int = YAML_BYTES) -> MapHeader:
    """Read the YAML of a map, up to `max_bytes` bytes, first document only. Raises MapError.

    Numbers are parsed from text as in yaml-cpp, since YAML 1.1 treats "0.05" and 5e-2 as text.
    """
    fields, unknown = _fields(path, max_bytes)
    for key in REQUIRED:
        if key not in fields:
            raise MapError(f"{path}: the key {key!r} is missing; required are {', '.join(REQUIRED)}.")
    if not isinstance(fields["image"], str):
        raise MapError(f"{path}: image is {short_repr(fields['image'])}, but must be a file name.")
    notes = [f"ignored keys: {short_repr(', '.join(unknown))}"] if unknown else []
    name, mode, negate = (str(fields[key]) for key in ("image", "mode", "negate"))
    image = path.parent / os.path.expanduser(name.removeprefix("file://"))  # noqa: PTH111 - never raises
    local_image = path.parent / PureWindowsPath(name).name
    if not os.path.isfile(image) and os.path.isfile(local_image):  # noqa: PTH113 - false for invalid names
        notes.append(
            f"image is {short_repr(name)}, which does not exist; reading {local_image.name} beside the YAML"
        )
        image = local_image
    if mode.lower() not in {"trinary", "scale", "raw"}:
        raise MapError(f"{path}: mode is {short_repr(mode)}, but must be trinary, scale or raw.")
    if negate.lower() not in _BOOLEANS:
        raise MapError(f"{path}: negate is {short_repr(negate)}, but must be 0, 1, true or false.")
    resolution, occupied, free = (
        _numbers(path, key, fields[key])[0] for key in ("resolution", "occupied_thresh", "free_thresh")
    )
    if resolution <= 0:
        raise MapError(f"{path}: resolution is {resolution:g}, but must be above 0 m.")
    if not 0 <= free <= occupied <= 1:
        raise MapError(
            f"{path}: free_thresh {free:g} and occupied_thresh {occupied:g} are out of order;"
            " must be 0 ≤ free_thresh ≤ occupied_thresh ≤ 1."
        )
    x, y, yaw = _numbers(
        path, "origin", fields["origin"], 3, "three numbers below 1e9: x, y in m, yaw in rad"
    )
    return MapHeader(
        image=image,
        resolution=resolution,
        origin=Point(x, y),
        yaw=yaw,
        negate=_BOOLEANS[negate.lower()],
        occupied=occupied,
        free=free,
        mode=mode.lower(),
        warnings=tuple(notes),
    )


@lru_cache(8)  # for the robots of a run
def _document(content: bytes) -> yaml.Node | None:
    content = content.replace(b"\t", b" ")
    try:
        return next(yaml.compose_all(content, Loader=yaml.BaseLoader), None)
    except yaml.reader.ReaderError:  # Latin-1 comments of old editors
        return next(yaml.compose_all(content.decode("latin-1"), Loader=yaml.BaseLoader), None)


def _fields(path: Path, max_bytes: int) -> tuple[dict[str, str | list[str]], list[str]]:
    """Return the values of known keys, with defaults, and the names of other keys."""
    try:
        document = _document(regular_file.read_bytes(path, max_bytes))
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror}.") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MapError(f"{path}: invalid YAML: {' '.join(str(error).split())}.") from error
    if not isinstance(document, yaml.MappingNode):
        raise MapError(f"{path}: the YAML must be a mapping with the keys {', '.join(KEYS)}.")
    fields: dict[str, str | list[str]] = {}
    unknown = []
    for key, value in document.value:
        name, entry = str(_node_text(key)), _node_text(value)
        if name not in KEYS:
            unknown.append(name)
        elif name in fields:
            raise MapError(f"{path}: duplicate key {name!r}; delete one.")
        elif entry not in ("", "~", "null"):
            fields[name] = entry
    return DEFAULTS | fields, unknown


def _node_text(node: yaml.Node) -> str | list[str]:
    """Return a text or a list of texts; deeper nodes, possibly recursive, become "…"."""
    if isinstance(node, yaml.SequenceNode):
        return [part.value.strip() if isinstance(part, yaml.ScalarNode) else "…" for part in node.value]
    return str(node.value).strip() if isinstance(node, yaml.ScalarNode) else "…"


def _numbers(
    path: Path, key: str, entry: str | list[str], count: int = 1, expected: str = "a number below 1e9"
) -> list[float]:
    try:
        numbers = [float(text) for text in ([entry] if isinstance(entry, str) else entry)]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) < 1e9 for number in numbers):
        raise MapError(f"{path}: {key} is {short_repr(entry)}, but must be {expected}.")
    return numbers


_BRIGHTNESS: Final = np.arange(3 * 255 + 1, dtype=np.float64) / 3
"""Brightness, 0 to 255, of a pixel by the sum of its red, green and blue."""
_FORMATS: Final = ("PNG", "PPM", "BMP", "GIF", "TIFF", "WEBP", "JPEG")
_GREY_SPREAD: Final = 32
"""Channel difference above which a pixel counts as coloured; JPEG and scanners cause smaller ones."""
_YAW_TOLERANCE: Final = 0.0025
"""Tolerance of a yaw beside a multiple of π/2, rad: files have 1.57 for π/2 and 4.71 for 3π/2."""
_UNKNOWN: Final = 0.196
"""Occupancy of grey 205, map_saver's value for unknown, rounded down; brighter pixels are floor."""
_POCKETS: Final = 0.01
"""Share of the image above which such grey inside walls causes a warning."""

_Pixels = tuple[UInt16s, Flags, list[str]]
"""(rows, columns) of red + green + blue, row 0 at the top; transparent pixels; warnings."""


@dataclass(frozen=True)
class MapLimits:
    """Limits of map files."""

    yaml_bytes: int = YAML_BYTES
    """Size of the YAML; real ones have less than 300 bytes."""
    cells: int = 16_000_000
    """Pixels of the image: 200 m by 200 m at 5 cm; needs about 0.5 GB while distances are computed."""
    image_bytes: int = 128_000_000
    """Size of the image file: 8 bytes per pixel, more than any format needs."""


_MAPS: Final = SharedCache[OccupancyGrid]()
_WARNINGS: Final = WeakKeyDictionary[OccupancyGrid, tuple[str, ...]]()


def load_map(path: Path | str, limits: MapLimits = MapLimits()) -> OccupancyGrid:
    """Return the floor plan of a map's YAML file and its image, or a generated one.

    Names such as "offices:7" select floors that `actors.floor.offices` generates.

    A pixel of brightness g in 0..255, the mean of its channels, has occupancy (255 − g)/255, or g/255 with
    `negate`; in mode raw g/100 up to 100, unknown above. Above `occupied_thresh` the cell is occupied, below
    `free_thresh` free, otherwise unknown, as are transparent pixels. A yaw that is a multiple of π/2 rotates
    the grid. Files of equal content give the same grid object. Raises MapError, or OfficesError for such a
    name.
    """
    if offices.is_name(path):
        return _MAPS.get(str(path), lambda: _generated(str(path)))
    path = Path(path)
    header = read_header(path, limits.yaml_bytes)
    try:
        image = regular_file.read_bytes(header.image, limits.image_bytes)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise MapError(
            f"{str(header.image)[:300]}: the map's image cannot be read: {getattr(error, 'strerror', error)}."
        ) from error
    content = hashlib.sha256(image).digest(), replace(header, image=Path()), limits
    return _MAPS.get(content, lambda: _grid(path, header, _decoded_image(header.image, image, limits)))


def map_warnings(path: Path | str) -> tuple[str, ...]:
    """Return warnings about a map that `load_map` reads, one sentence each; none for generated floors.

    Raises what `load_map` raises.
    """
    grid = load_map(path)
    return tuple(f"{Path(path).name}: {notes}" for notes in _WARNINGS.get(grid, ()))


def _generated(name: str) -> OccupancyGrid:
    cells = np.where(offices.cells_of(name), OCCUPIED, FREE).astype(np.uint8)
    return OccupancyGrid(cells, RESOLUTION, Point(0.0, 0.0))


def _decoded_image(path: Path, content: bytes, limits: MapLimits) -> _Pixels:
    """Return the pixels of an image file, first frame only. Raises MapError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # decompression bombs (our limit is lower) and invalid metadata
            with Image.open(io.BytesIO(content), formats=_FORMATS) as image:
                if image.width * image.height > limits.cells:
                    raise ValueError(f"{image.width} x {image.height} pixels; the limit is {limits.cells}")
                return _pixels(image)
    except UnidentifiedImageError as error:
        raise MapError(f"{path}: unknown image format; supported are {', '.join(_FORMATS)}.") from error
    except Exception as error:  # Pillow raises many types for damaged images
        raise MapError(f"{path}: the map's image cannot be read: {error}.") from error


def _pixels(image: Image.Image) -> _Pixels:
    notes = ["JPEG blurs the edges of walls; save the image as PNG"] if image.format == "JPEG" else []
    if image.mode.startswith("I;16") or (image.mode, image.format) == ("I", "PPM"):
        wide = np.asarray(image).astype(np.int64)
        sums = ((wide + 128) // 257 * 3).astype(np.uint16)
        return sums, wide == image.info.get("transparency", -1), notes
    if image.mode in {"I", "F"}:
        raise ValueError("32 bits per channel; must be 8 or 16")
    if not image.has_transparency_data and image.mode in {"1", "L"}:
        return np.multiply(np.asarray(image.convert("L")), 3, dtype=np.uint16), np.array(False), notes
    channels = np.asarray(image.convert("RGBA"))
    colours, transparent = channels[..., :3], channels[..., 3] < 255
    coloured = np.argwhere((np.ptp(colours, axis=2) > _GREY_SPREAD) & ~transparent)
    if coloured.size:
        row, column = coloured[0]
        notes.append(
            f"{len(coloured)} pixels are coloured, the first in column {column}, row {row} from the top:"
            f" {tuple(colours[row, column].tolist())}; using the mean of red, green and blue"
        )
    return colours.sum(axis=2, dtype=np.int64).astype(np.uint16), transparent, notes


def _grid(path: Path, header: MapHeader, pixels: _Pixels) -> OccupancyGrid:
    sums, transparent, notes = pixels
    occupancy = (_BRIGHTNESS if header.negate else 255.0 - _BRIGHTNESS) / 255.0
    if header.mode == "raw":  # NaN is neither free nor occupied
        occupancy = np.where(_BRIGHTNESS <= 100, _BRIGHTNESS / 100, np.nan)
    states = np.full(occupancy.shape, UNKNOWN, dtype=np.uint8)
    states[occupancy > header.occupied] = OCCUPIED
    states[occupancy < header.free] = FREE
    cells = states[sums]
    cells[transparent] = UNKNOWN
    if header.mode != "raw" and header.free > _UNKNOWN:
        notes += _unknown_as_free(header, np.where(cells == FREE, sums, 0), occupancy)
    turns = round(header.yaw / (math.pi / 2))
    deviation = abs(header.yaw - turns * math.pi / 2)
    height, width = cells.shape[0] * header.resolution, cells.shape[1] * header.resolution
    x, y = header.origin
    if deviation > _YAW_TOLERANCE:
        raise MapError(
            f"{path}: origin has yaw {header.yaw:g} rad, but must be a multiple of 90°; rotate the"
            f" image by {math.degrees(header.yaw):.4g}° counter-clockwise and set yaw to 0."
        )
    if turns % 4 or deviation > 1e-4:
        notes.append(
            f"origin has yaw {header.yaw:g}: the map is rotated by {turns % 4 * 90}° counter-clockwise; AMCL"
            " and Nav2's costmaps ignore the yaw"
        )
    corners = Point(x, y), Point(x - height, y), Point(x - width, y - height), Point(x, y - width)
    grid = OccupancyGrid(np.rot90(np.flipud(cells), -turns), header.resolution, corners[turns % 4])
    if max(map(abs, (*grid.origin, *grid.corner))) > GREATEST_COORDINATE:
        raise MapError(
            f"{path}: origin ({x:.10g}, {y:.10g}) is too far away: coordinates of the map must be within"
            f" ±{GREATEST_COORDINATE:.0f} m; set origin to [0, 0, 0] and subtract ({x:.10g}, {y:.10g}) from"
            " all your coordinates."
        )
    _WARNINGS[grid] = *header.warnings, *notes
    return grid


def _unknown_as_free(header: MapHeader, floor: UInt16s, occupancy: Floats) -> list[str]:
    """Return a warning if unknown grey counts as free at the border or in large pockets.

    `floor`: the sums of free pixels, 0 elsewhere.
    """
    grey = (occupancy > _UNKNOWN)[floor] & (floor > 0)
    border = bool(np.r_[grey[0], grey[-1], grey[:, 0], grey[:, -1]].any())
    count = np.count_nonzero(grey)
    if not border and count < _POCKETS * grey.size:
        return []
    level = int(np.bincount(floor[grey]).argmax())
    return [
        f"free_thresh {header.free:g} makes grey {level / 3:.0f} free floor:"
        f" {count * header.resolution * header.resolution:.3g} m²"
        f"{', up to the image border' * border}; if this grey means unknown, as 205 in map_saver,"
        " set free_thresh to"
        f" {math.floor(1000 * occupancy[level]) / 1000:g}"
    ]
