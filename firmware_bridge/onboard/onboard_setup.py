"""What a base and a bridge are started with: JSON files, written by whoever starts the robot."""

from pathlib import Path
from typing import Final, TypeVar

import msgspec

from actors.runtime.errors import AcrcError

OPENNI: Final = "openni"
"""The range sensor that is no port: a depth camera, found by itself."""
S = TypeVar("S", bound=msgspec.Struct)


class BaseSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a base needs to know."""

    robot: str
    model: str
    """Name of a shipped robot model, or the path of a model file."""
    sensor: str | None
    start: tuple[float, float, float]
    """Where it is switched on: x, y in m and heading in rad, map frame."""
    places: int
    """How many it has to clean at first."""
    step_us: int
    base: str
    """Path of the Kobuki's port."""
    range: str | None
    """Path of the lidar's port, or OPENNI; None = there is none."""
    listen: str | None = None
    """Where the operator's laptop may connect, `tls/HOST:PORT`; None = nowhere."""
    keys: str | None = None
    """Folder with the robot's own keys; needed to listen."""
    last_pose: str | None = None
    """File with where the robot last held itself to be; None: nobody keeps it."""
    patience_s: float | None = 30.0
    """A robot or bridge that does not answer for so long hangs, and the base ends, s; own choice: a restarted
    robot should be there by then. None: a debugger may hold it."""


class BridgeSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a bridge needs to know."""

    robot: str
    step_us: int
    radio: str
    """Path of the board's port."""
    address: int
    pan: int
    channel: int
    """11 to 26."""
    power_dbm: float
    board: bool = True
    """False: at the port is a transceiver of a laboratory's, without a board (`transceiver_line`)."""


def load(path: Path, kind: type[S]) -> S:
    """The set-up in a JSON file. Raises AcrcError."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (OSError, ValueError, RecursionError) as error:
        raise AcrcError(f"{path}: no {kind.__name__}: {error}") from None
