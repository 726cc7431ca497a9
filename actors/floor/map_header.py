"""The YAML file of a ROS map_server map: its keys, their defaults, and the image file that it names."""

import os
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Final

import yaml

from actors.geometry import Point
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.wording import brief

REQUIRED: Final = ("image", "resolution", "origin")
DEFAULTS: Final = {"negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196", "mode": "trinary"}
"""Optional keys. The thresholds are those that map_saver of ROS 1 and of Nav2 writes for mode trinary."""
KEYS: Final = (*REQUIRED, *DEFAULTS)
YAML_BYTES: Final = 65_536
_BOOLEANS: Final = yaml.SafeLoader.bool_values | {"0": False, "1": True}


class MapError(AcrcError):
    """A map file that cannot be used."""


@dataclass(frozen=True)
class MapHeader:
    """The checked content of the YAML."""

    image: Path
    resolution: float
    origin: Point
    yaw: float
    """Rotation of the image about `origin`, counter-clockwise, rad."""
    negate: bool
    occupied: float
    free: float
    mode: str
    """trinary, scale or raw."""
    warnings: tuple[str, ...]

    def text(self, image: str) -> str:
        """Return the YAML of the same map with its image in the file `image`."""
        return (
            f"image: {image}\nmode: {self.mode}\nresolution: {self.resolution}\n"
            f"origin: [{self.origin.x}, {self.origin.y}, {self.yaw}]\nnegate: {self.negate:d}\n"
            f"occupied_thresh: {self.occupied}\nfree_thresh: {self.free}\n"
        )


def read_header(path: Path, most: int = YAML_BYTES) -> MapHeader:
    """Read the YAML of a map, of at most so many bytes; of several documents the first. Raises MapError.

    Numbers are read from their text, as yaml-cpp does: YAML 1.1 takes "0.05" and 5e-2 as text.
    """
    fields, unknown = _fields(path, most)
    for key in REQUIRED:
        if key not in fields:
            raise MapError(f"{path}: the key {key!r} is missing; a map needs {', '.join(REQUIRED)}.")
    if not isinstance(fields["image"], str):
        raise MapError(f"{path}: image is {brief(fields['image'])}, but must be the name of a file.")
    told = [f"ignored keys: {brief(', '.join(unknown))}"] if unknown else []
    name, mode, negate = (str(fields[key]) for key in ("image", "mode", "negate"))
    image = path.parent / os.path.expanduser(name.removeprefix("file://"))  # noqa: PTH111 - never raises
    beside = path.parent / PureWindowsPath(name).name
    if not os.path.isfile(image) and os.path.isfile(beside):  # noqa: PTH113 - false for any odd name
        told.append(f"image is {brief(name)}, which does not exist; {beside.name} beside the YAML is read")
        image = beside
    if mode.lower() not in {"trinary", "scale", "raw"}:
        raise MapError(f"{path}: mode is {brief(mode)}, but must be trinary, scale or raw.")
    if negate.lower() not in _BOOLEANS:
        raise MapError(f"{path}: negate is {brief(negate)}, but must be 0, 1, true or false.")
    resolution, occupied, free = (
        _numbers(path, key, fields[key])[0] for key in ("resolution", "occupied_thresh", "free_thresh")
    )
    if resolution <= 0:
        raise MapError(f"{path}: resolution is {resolution:g}, but a cell must be longer than 0 m.")
    if not 0 <= free <= occupied <= 1:
        raise MapError(
            f"{path}: free_thresh {free:g} and occupied_thresh {occupied:g} are out of order;"
            " right is 0 ≤ free_thresh ≤ occupied_thresh ≤ 1."
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
        warnings=tuple(told),
    )


def _fields(path: Path, most: int) -> tuple[dict[str, str | list[str]], list[str]]:
    """The values of the known keys, with the defaults of those that are absent; the names of other keys."""
    try:
        content = regular_file.content(path, most).replace(b"\t", b" ")
        try:
            document = next(yaml.compose_all(content, Loader=yaml.BaseLoader), None)
        except yaml.reader.ReaderError:  # comments in the Latin-1 of older editors
            text = content.decode("latin-1")
            document = next(yaml.compose_all(text, Loader=yaml.BaseLoader), None)
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror}.") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MapError(f"{path}: this is not YAML: {' '.join(str(error).split())}.") from error
    if not isinstance(document, yaml.MappingNode):
        raise MapError(f"{path}: a map's YAML must be a list of keys and values, {', '.join(KEYS)}.")
    fields: dict[str, str | list[str]] = {}
    unknown = []
    for key, value in document.value:
        name, given = str(_plain(key)), _plain(value)
        if name not in KEYS:
            unknown.append(name)
        elif name in fields:
            raise MapError(f"{path}: the key {name!r} is there twice; delete one of the two.")
        elif given not in ("", "~", "null"):
            fields[name] = given
    return DEFAULTS | fields, unknown


def _plain(node: yaml.Node) -> str | list[str]:
    """A text, or a list of texts; nodes within those may refer to one another without end."""
    if isinstance(node, yaml.SequenceNode):
        return [part.value.strip() if isinstance(part, yaml.ScalarNode) else "…" for part in node.value]
    return str(node.value).strip() if isinstance(node, yaml.ScalarNode) else "…"


def _numbers(
    path: Path, key: str, given: str | list[str], count: int = 1, right: str = "a number below 1e9"
) -> list[float]:
    try:
        numbers = [float(text) for text in ([given] if isinstance(given, str) else given)]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) < 1e9 for number in numbers):
        raise MapError(f"{path}: {key} is {brief(given)}, but must be {right}.")
    return numbers
