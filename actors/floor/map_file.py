"""Floor plans from files: the YAML and image of ROS map_server (wiki.ros.org/map_server, "Map format")."""

import hashlib
import io
import reprlib
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from actors.floor import offices
from actors.floor.drawing import RESOLUTION
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.sharing import Shared
from actors.geometry import Point
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError

KEYS: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
"""What the YAML must hold; `mode: trinary` may stand beside it."""
_BRIEF: Final = reprlib.Repr()
"""YAML can refer to one list a million times, so its whole text may be without end."""
_BRIEF.maxlevel, _BRIEF.maxstring, _BRIEF.maxother = 2, 80, 80


class MapError(AcrcError):
    """A map file that cannot be used."""


@dataclass(frozen=True)
class MapLimits:
    """How much of a map file is read at most."""

    yaml_bytes: int = 65_536
    """Size of the YAML; real ones have under 300 bytes."""
    cells: int = 16_000_000
    """Pixels of the image: 200 m by 200 m at 5 cm, about 0.5 GB while distances are computed."""
    image_bytes: int = 128_000_000
    """Size of the image's file: 8 bytes for each of so many pixels, more than any format takes."""


@dataclass(frozen=True)
class _Header:
    """The checked content of the YAML."""

    image: Path
    resolution: float
    origin: Point
    negate: bool
    occupied: float
    free: float


_MAPS: Final = Shared[OccupancyGrid]()


def load_map(path: Path | str, limits: MapLimits = MapLimits()) -> OccupancyGrid:
    """The floor plan in the YAML file `path` and the image it names, which lies beside it; or a drawn one.

    "offices:7" and the like are names of floors that `actors.floor.offices` draws.

    A pixel of brightness g in 0..255 is (255 − g)/255 occupied, or g/255 with `negate`: above
    `occupied_thresh` the cell is occupied, below `free_thresh` free, else unknown (mode trinary). The image
    is a PNG, PGM or BMP with 8 bits per channel. Files with the same bytes give one grid, wherever they lie.
    Raises MapError, or OfficesError for such a name.
    """
    if offices.is_name(path):
        return _MAPS.get(str(path), lambda: _drawn(str(path)))
    path = Path(path)
    header = _header(path, limits)
    image = _image(header.image, limits)
    content = hashlib.sha256(image).digest(), replace(header, image=Path()), limits
    return _MAPS.get(content, lambda: _grid(header, image, limits))


def _drawn(name: str) -> OccupancyGrid:
    cells = np.where(offices.cells_of(name), OCCUPIED, FREE).astype(np.uint8)
    return OccupancyGrid(cells, RESOLUTION, Point(0.0, 0.0))


def _grid(header: _Header, image: bytes, limits: MapLimits) -> OccupancyGrid:
    grey = np.arange(256, dtype=np.float64)
    occupancy = (grey if header.negate else 255.0 - grey) / 255.0
    states = np.full(grey.shape, UNKNOWN, dtype=np.uint8)
    states[occupancy > header.occupied] = OCCUPIED
    states[occupancy < header.free] = FREE
    cells = states[_grey(header.image, image, limits)]
    return OccupancyGrid(np.flipud(cells), header.resolution, header.origin)


def _header(path: Path, limits: MapLimits) -> _Header:
    fields = _fields(path, limits)
    for key in KEYS:
        if key not in fields:
            raise MapError(f"{path}: the key {key!r} is missing; a map needs {', '.join(KEYS)}.")
    for key in fields:
        if key not in (*KEYS, "mode"):
            raise MapError(
                f"{path}: the key {_BRIEF.repr(key)} is not known; a map has {', '.join(KEYS)} and mode."
            )
    if fields.get("mode", "trinary") != "trinary":
        raise MapError(f"{path}: mode is {_BRIEF.repr(fields['mode'])}, but only 'trinary' is supported.")
    image = fields["image"]
    if not isinstance(image, str) or not image:
        raise MapError(f"{path}: image is {_BRIEF.repr(image)}, but must be the name of a file.")
    negate = fields["negate"]
    if not isinstance(negate, int) or negate not in (0, 1):
        raise MapError(f"{path}: negate is {_BRIEF.repr(negate)}, but must be 0 or 1.")
    resolution = _number(path, fields, "resolution")
    if resolution <= 0:
        raise MapError(f"{path}: resolution is {resolution:g}, but a cell must be longer than 0 m.")
    occupied, free = _number(path, fields, "occupied_thresh"), _number(path, fields, "free_thresh")
    if not 0 <= free <= occupied <= 1:
        raise MapError(
            f"{path}: free_thresh {free:g} and occupied_thresh {occupied:g} are out of order;"
            " right is 0 ≤ free_thresh ≤ occupied_thresh ≤ 1."
        )
    return _Header(path.parent / image, resolution, _origin(path, fields), bool(negate), occupied, free)


def _fields(path: Path, limits: MapLimits) -> dict[Any, Any]:
    """The mapping in the YAML file."""
    try:
        with regular_file.opened(path) as file:
            text = file.read(limits.yaml_bytes + 1)
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror}.") from error
    if len(text) > limits.yaml_bytes:
        raise MapError(
            f"{path}: a map's YAML may have at most {limits.yaml_bytes} bytes, but this is larger."
        )
    try:
        fields = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MapError(f"{path}: this is not YAML: {' '.join(str(error).split())}.") from error
    if not isinstance(fields, dict):
        raise MapError(f"{path}: a map's YAML must be a list of keys and values, {', '.join(KEYS)}.")
    return fields


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9


def _number(path: Path, fields: dict[Any, Any], key: str) -> float:
    value = fields[key]
    if not _is_number(value):
        raise MapError(f"{path}: {key} is {_BRIEF.repr(value)}, but must be a number below 1e9.")
    return float(value)


def _origin(path: Path, fields: dict[Any, Any]) -> Point:
    origin = fields["origin"]
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_is_number, origin)):
        raise MapError(
            f"{path}: origin is {_BRIEF.repr(origin)}, "
            "but must be three numbers below 1e9: x and y in m, yaw 0."
        )
    x, y, yaw = map(float, origin)
    if yaw != 0:
        raise MapError(
            f"{path}: the origin is turned by {yaw:g} rad, but only maps with yaw 0 are supported."
        )
    return Point(x, y)


def _image(path: Path, limits: MapLimits) -> bytes:
    """The image's file."""
    try:
        with regular_file.opened(path) as file:
            content = file.read(limits.image_bytes + 1)
    except OSError as error:
        raise MapError(f"{path}: the map's image cannot be read: {error.strerror}.") from error
    except ValueError as error:  # a zero byte in its name
        raise MapError(f"{path}: the map's image cannot be read: {error}.") from error
    if len(content) > limits.image_bytes:
        raise MapError(
            f"{path}: a map's image may have at most {limits.image_bytes} bytes, but this is larger."
        )
    return content


def _grey(path: Path, content: bytes, limits: MapLimits) -> NDArray[np.uint8]:
    """(rows, columns) brightness of the image in the file `path`, row 0 its top."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # our own limit is the lower one
            with Image.open(io.BytesIO(content), formats=("PNG", "PPM", "BMP")) as image:
                if image.width * image.height > limits.cells:
                    raise MapError(
                        f"{path}: the image has {image.width} x {image.height} pixels,"
                        f" but at most {limits.cells} are allowed."
                    )
                return _brightness(path, image)
    except UnidentifiedImageError as error:
        raise MapError(
            f"{path}: this is not an image that can be read; right are PNG, PGM and BMP."
        ) from error
    except Image.DecompressionBombError as error:
        raise MapError(f"{path}: the image has far more than the {limits.cells} pixels allowed.") from error
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises on damaged images
        raise MapError(f"{path}: the map's image cannot be read: {error}.") from error


def _brightness(path: Path, image: Image.Image) -> NDArray[np.uint8]:
    if image.mode in {"1", "L"}:
        return np.asarray(image.convert("L"))
    if image.mode not in {"P", "PA", "LA", "RGB", "RGBA"}:
        raise MapError(f"{path}: the image is of Pillow's mode {image.mode!r}, but must be grey with 8 bits.")
    channels = np.asarray(image.convert("RGBA"))
    if (channels[..., 3] != 255).any():
        raise MapError(f"{path}: the image has transparent pixels, but each must be black, white or grey.")
    coloured = np.argwhere((channels[..., :2] != channels[..., 1:3]).any(axis=2))
    if coloured.size:
        row, column = (int(index) for index in coloured[0])
        red, green, blue = (int(value) for value in channels[row, column, :3])
        raise MapError(
            f"{path}: the pixel in column {column}, row {row} from the top has the colour"
            f" ({red}, {green}, {blue}), but each must be black, white or grey."
        )
    return channels[..., 0]
