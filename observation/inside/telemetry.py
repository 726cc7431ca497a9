"""What is kept of a robot that is executed again: arrays and rows, and how they travel between processes.

Whoever's code ran wrote them, so nothing is believed of them but what their types and sizes say.
"""

import struct
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.runtime.errors import AcrcError

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Whole = NDArray[np.int64]
PART: Final = struct.Struct("<I")
"""Before each part of what is told while a run goes on: how many bytes it has."""
MOST_BYTES: Final = 1 << 30
"""Of one robot's telemetry; ten minutes have 20 MB."""


class TelemetryError(AcrcError):
    """Telemetry that makes no sense."""


class Doing(msgspec.Struct, frozen=True):
    """What a robot is about, from an instant on."""

    instant: int
    """µs by its own time."""
    activity: str
    """One of ACTIVITIES."""
    destination: str = ""
    """Where it heads for, as in "r1/3"; empty if for nowhere, or nobody's place."""
    point: tuple[float, float] | None = None
    """The same in m, map frame."""


ACTIVITIES: Final = (
    "driving", "planning", "no trajectory", "backing out", "BLOCKED", "adopted", "elsewhere", "paused",
    "aborted", "idle",
)  # fmt: skip
"""What a robot may be about. "adopted": it drives to a place that was another's; "elsewhere": to a point that
is nobody's place; "no trajectory": navigation has a way, and nothing to follow it with; "BLOCKED": it holds
itself to be; "aborted": navigation has given up; "idle": there is nothing that it wants."""


class Known(msgspec.Struct, frozen=True):
    """The component's knowledge as rows of a table, from an instant on."""

    instant: int
    rows: tuple[tuple[str, str], ...]


class ReplicaContact(msgspec.Struct, frozen=True):
    """A replica that the node has from an instant on, or has no longer."""

    instant: int
    peer: str
    heard: int | None
    """When it had come, µs; None: it is forgotten."""


class Learnt(msgspec.Struct, frozen=True):
    """A decision of the adaptation."""

    instant: int
    by: str
    """The process or the ensemble's exchange."""
    words: str
    source: str
    """Whose knowledge it was made from."""
    age: int
    """How old that was, µs."""


class Ragged(msgspec.Struct, frozen=True):
    """Rows of different lengths: points, (k, 2), m."""

    counts: Whole
    """(n,)"""
    values: Singles
    """(sum of counts, 2)"""

    def rows(self) -> list[Singles]:
        """One array a row."""
        return np.split(self.values, np.cumsum(self.counts)[:-1]) if len(self.counts) else []


class Inside(msgspec.Struct, frozen=True):
    """One process of a robot, looked into at `instants`."""

    robot: str
    first_step: int
    instants: Whole
    """(n,): µs by the robot's own time."""
    estimates: Floats
    """(n, 3): x, y, m, and heading, rad, map frame."""
    covariances: Floats
    """(n, 3): of x, of x and y, of y, m²."""
    lost: Floats
    """(n,): probability that it is somewhere else altogether."""
    scans: Ragged
    """n rows: where the last sweep met something, map frame by the estimate."""
    particles_at: Whole
    """(m,): when they changed, µs ..."""
    particles: Ragged
    """... and m rows."""
    plans_at: Whole
    plans: Ragged
    """A row for each plan; an empty one where it was dropped."""
    twists: Floats
    """(n, 2): commanded speed, m/s, and turn rate, rad/s: the chosen arc."""
    cell: float
    """Of the local cost map, m."""
    costs_at: Whole
    """(c,): when navigation has steered by it, µs."""
    costs: NDArray[np.uint8]
    """(c, rows, columns): as costmap_2d has them, row 0 the southernmost."""
    corners: Floats
    """(c, 3): pose of the window's south-west corner, map frame."""
    doings: tuple[Doing, ...]
    knowledge: tuple[Known, ...]
    contacts: tuple[ReplicaContact, ...]
    learnt: tuple[Learnt, ...]
    fault: str | None = None
    """Why it could not be followed to its end."""


def encode(inside: Inside) -> bytes:
    """For the pipe."""
    return msgspec.msgpack.encode(inside, enc_hook=_plain)


def decode(data: bytes) -> Inside:
    """What `encode` made. Raises TelemetryError for anything else."""
    try:
        inside = msgspec.msgpack.decode(data, type=Inside, dec_hook=_array)
    except (ValueError, TypeError, RecursionError) as error:
        raise TelemetryError(f"a robot's telemetry makes no sense: {error}") from None
    if wrong := _misfit(inside):
        raise TelemetryError(f"a robot's telemetry makes no sense: {wrong}")
    return inside


def ragged(rows: list[Singles]) -> Ragged:
    """Rows of points, (k, 2) each, put together."""
    counts = np.array([len(row) for row in rows], np.int64)
    values = np.concatenate(rows) if rows else np.zeros((0, 2))
    return Ragged(counts, values.astype(np.float32).reshape(-1, 2))


def _misfit(inside: Inside) -> str:
    """Which arrays do not fit one another; empty if all do."""
    n, c = len(inside.instants), len(inside.costs_at)
    shapes = {
        "estimates": (inside.estimates, (n, 3)),
        "covariances": (inside.covariances, (n, 3)),
        "lost": (inside.lost, (n,)),
        "twists": (inside.twists, (n, 2)),
        "corners": (inside.corners, (c, 3)),
    }
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            return f"{name} has the shape {array.shape}, and must have {shape}"
    for name, rows, count in (
        ("scans", inside.scans, n),
        ("particles", inside.particles, len(inside.particles_at)),
        ("plans", inside.plans, len(inside.plans_at)),
    ):
        counts = rows.counts
        if counts.shape != (count,) or rows.values.shape != (int(counts.sum()), 2) or (counts < 0).any():
            return f"{name} has not {count} rows"
    if inside.costs.ndim != 3 or len(inside.costs) != c:
        return f"costs has the shape {inside.costs.shape}, and must have {c} windows"
    unknown = {one.activity for one in inside.doings} - set(ACTIVITIES)
    return f"{sorted(unknown)} are no activities" if unknown else ""


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.shape, np.ascontiguousarray(value).tobytes()
    raise NotImplementedError(type(value))


def _array(kind: Any, told: Any) -> Any:
    """The array of the type that the field has."""
    dtype = np.dtype(kind.__args__[1].__args__[0])
    shape, data = told
    if not all(isinstance(side, int) and side >= 0 for side in shape) or not isinstance(data, bytes):
        raise ValueError("an array without a shape")
    return np.frombuffer(data, dtype).reshape(shape)
