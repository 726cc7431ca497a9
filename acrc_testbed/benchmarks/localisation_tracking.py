"""Localisation logs, runs of the particle filter on them, and errors against the ground truth."""

import io
import json
import math
import tempfile
import time
import zipfile
import zlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from acrc_testbed.explanation.episodes import true_intervals
from actors.array_types import Flags, Floats, Int64s, Singles, UInt16s
from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import MapError, load_map
from actors.geometry import Pose, wrap
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Scan
from actors.randomness import generator
from actors.robot.localisation import PRESETS as PARAMETERS
from actors.robot.localisation import Amcl, DeadReckoning, LikelihoodField, Localisation, likelihood_field
from actors.robot.sweep import OdometryBuffer
from actors.robot_model import RangeSensor
from actors.runtime.errors import AcrcError
from actors.settings import decode

FORMAT: Final = "acrc-localisation-log"
VERSION: Final = 1
POSES: Final = "time_us,x,y,heading"


class CourseLogError(AcrcError):
    """A log that cannot be read."""


@dataclass(frozen=True, eq=False)
class Course:
    """Input of a localisation on one drive, with the ground truth; all arrays are in order of time."""

    grid: OccupancyGrid
    sensor: RangeSensor
    start: Pose
    """The true pose at the first odometry pose, m and rad, map frame."""
    instants: Int64s
    """(n,): times of the odometry, µs."""
    odometry: Floats
    """(n, 3): x, y, heading, m and rad, odometry frame."""
    truth: Floats
    """(n, 3): true poses at `instants`, m and rad, map frame."""
    stamps: Int64s
    """(k,): times of the scans, µs."""
    scans: UInt16s
    """(k, rays): ranges, mm; NO_ECHO_MM = no echo within range."""

    @property
    def origin(self) -> Pose:
        """Pose of the odometry frame in the map frame at the start."""
        return self.start.frame(Pose(*self.odometry[0].tolist()))


TEXT_BYTES: Final = 400_000_000
"""Largest table of a log: two hours of scans at 10 Hz with 640 rays have 350 MB."""
_SMALL_BYTES: Final = 65_536
"""Largest about.json and map.yaml."""
_IMAGE_BYTES: Final = 32_000_000
"""Largest map.png in the archive."""
_MAX_COORDINATE: Final = 1e6
"""Largest coordinate, m."""
_Coordinate = Annotated[float, msgspec.Meta(ge=-_MAX_COORDINATE, le=_MAX_COORDINATE)]


def read_course(file: Path) -> Course:
    """Return the course of a log; ground truth is interpolated between rows. Raises CourseLogError."""
    try:
        with zipfile.ZipFile(file) as archive:
            return _Log(file, archive).course()
    except zipfile.BadZipFile as error:
        raise CourseLogError(f"{file}: not a localisation log (a ZIP archive): {error}.") from error
    except (OSError, EOFError, zlib.error, RuntimeError, NotImplementedError, ValueError) as error:
        raise CourseLogError(f"{file}: the log cannot be read: {error}.") from error


@dataclass(frozen=True)
class _Log:
    """Reader of one log."""

    file: Path
    archive: zipfile.ZipFile

    def course(self) -> Course:
        sensor, start = self._about()
        grid = self._grid()
        instants, odometry = self._poses("odometry.csv")
        stamps, truth = self._poses("truth.csv")
        if stamps[0] > instants[0] or stamps[-1] < instants[-1]:
            raise self._error(
                f"truth.csv covers {stamps[0]} to {stamps[-1]} µs, but must cover odometry.csv, "
                f"{instants[0]} to {instants[-1]} µs"
            )
        if not np.array_equal(stamps, instants):  # headings turn the short way round
            columns = (truth[:, 0], truth[:, 1], np.unwrap(truth[:, 2]))
            truth = np.stack([np.interp(instants, stamps, column) for column in columns], axis=1)
        return Course(grid, sensor, start, instants, odometry, truth, *self._scans(sensor.rays))

    def _about(self) -> tuple[RangeSensor, Pose]:
        try:
            about = json.loads(self._bytes("about.json", _SMALL_BYTES))
        except (ValueError, RecursionError) as error:
            raise self._error(f"about.json is not JSON: {error}") from error
        if not isinstance(about, dict) or (about.get("format"), about.get("version")) != (FORMAT, VERSION):
            raise self._error(f'about.json must have "format": "{FORMAT}" and "version": {VERSION}')
        try:
            sensor = decode(RangeSensor, about.get("sensor"), "sensor")
        except AcrcError as error:
            raise self._error(f"in about.json, {error}") from None
        start = about.get("start")
        try:
            x, y, heading = msgspec.convert(start, tuple[_Coordinate, _Coordinate, _Coordinate])
        except msgspec.ValidationError:
            raise self._error(
                f"start in about.json is {start!r}, but must be x and y in m and a heading in rad"
            ) from None
        return sensor, Pose(x, y, wrap(heading))

    def _grid(self) -> OccupancyGrid:
        """Return the map; `load_map` reads it from a temporary folder."""
        with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
            header, image = Path(folder) / "map.yaml", Path(folder) / "map.png"
            header.write_bytes(self._bytes("map.yaml", _SMALL_BYTES))
            image.write_bytes(self._bytes("map.png", _IMAGE_BYTES))
            try:
                return load_map(header)
            except MapError as error:
                raise self._error(str(error).replace(f"{folder}/", "").rstrip(".")) from error

    def _poses(self, name: str) -> tuple[Int64s, Floats]:
        times, poses = self._numbers(name, POSES)
        if not (np.abs(poses) <= _MAX_COORDINATE).all():
            raise self._error(f"{name} has a value beyond ± {_MAX_COORDINATE:g} or NaN")
        beyond = (poses[:, 2] <= -np.pi) | (poses[:, 2] > np.pi)
        poses[beyond, 2] = [wrap(angle) for angle in poses[beyond, 2].tolist()]
        return times, poses

    def _scans(self, rays: int) -> tuple[Int64s, UInt16s]:
        columns = ",".join(["time_us", *(f"r{i}" for i in range(rays))])
        times, ranges = self._numbers("scans.csv", columns)
        if not ((ranges >= 0) & (ranges <= NO_ECHO_MM) & (ranges == np.floor(ranges))).all():
            raise self._error(f"scans.csv has a range that is not a whole number from 0 to {NO_ECHO_MM} mm")
        return times, ranges.astype(np.uint16)

    def _numbers(self, name: str, columns: str) -> tuple[Int64s, Floats]:
        """Return the first column of a table, times, and the other columns."""
        raw = self._bytes(name, TEXT_BYTES)
        header, _, rows = raw.decode("ascii", "replace").partition("\n")
        if header.strip() != columns:
            short = columns if len(columns) < 80 else f"{columns[:30]}… with {columns.count(',')} rays"
            raise self._error(
                f"{name} begins with {header.strip()[:40]!r}, but its first line must be {short}"
            )
        if not rows.strip():
            raise self._error(f"{name} has no rows; at least one is required")
        try:
            table = np.loadtxt(io.StringIO(rows), delimiter=",", comments=None, ndmin=2)
        except (ValueError, OverflowError) as error:
            raise self._error(f"{name} is not a table of numbers: {error}") from error
        if table.shape[1] != columns.count(",") + 1:
            raise self._error(f"{name} has {table.shape[1]} columns, but its first line names another number")
        times = table[:, 0]
        if not (np.isfinite(times) & (np.abs(times) < 2**53) & (times == np.floor(times))).all():
            raise self._error(f"{name} has a time_us that is not a whole number")
        if (np.diff(times) <= 0).any():
            row = int(np.argmax(np.diff(times) <= 0)) + 2
            raise self._error(f"time_us in row {row} of {name} is not later than in the row before")
        return times.astype(np.int64), table[:, 1:]

    def _bytes(self, name: str, max_bytes: int) -> bytes:
        try:
            with self.archive.open(name) as member:
                content = member.read(max_bytes + 1)
        except KeyError:
            raise self._error(f"{name} is missing") from None
        if len(content) > max_bytes:
            raise self._error(f"{name} has more than the {max_bytes} bytes allowed")
        return content

    def _error(self, problem: str) -> CourseLogError:
        return CourseLogError(f"{self.file}: {problem}.")


Preset = Literal["chapter", "robust", "odometry"]
"""Preset of the filter, or the odometry alone."""
PRESETS: Final[tuple[Preset, ...]] = ("chapter", "robust")
STEP_US: Final = 100_000
"""Interval between odometry poses of the simulated courses, µs."""
TRACKED: Final = 0.5
"""Error above which a robot is not tracking, m."""
LOST_ERROR: Final = 1.0
"""Error above which a robot is lost, m."""
NEES_BOUNDS: Final = (0.2158, 9.3484)
"""The two-sided 95 % bounds of χ² with three degrees of freedom (quantiles 0.025 and 0.975)."""
REPORT_PROBABILITY: Final = 0.95
"""Estimated probability above which a robot reports that it is lost. With 0.5, more than half of the reports
among many robots at 58° would be short false alarms."""
LOST_STEPS: Final = 30
"""Minimum number of consecutive steps with an error above LOST that count as a lost interval; 3 s."""
CLEAR_STEPS: Final = 50
"""Number of steps before and after a report without an error above BEYOND that make it false; 5 s."""
RELOCALISED: Final = (0.5, math.radians(15.0))
"""Position and heading errors, m and rad, below which a lost robot has relocalised."""


@dataclass(frozen=True, eq=False)
class EstimatedTrack:
    """Estimates of a localisation along a course."""

    poses: Floats
    """(n, 3): x, y, heading, m and rad, map frame."""
    covariances: Floats
    """(n, 3, 3)."""
    lost: Floats
    """(n,): estimated probability of being lost."""
    costs: Floats
    """(n,), CPU s of each call."""
    outcome: dict[str, object]
    """Counters of the localisation."""


def localisation(course: Course, preset: Preset, seed: int, *, placed: bool = True) -> Localisation:
    """Return a new localisation for a course, with its own random stream.

    `placed`: initialise the filter at the start pose; otherwise globally on the map.
    """
    if preset == "odometry":
        return DeadReckoning(course.origin)
    parameters = PARAMETERS[preset]
    field = _field(course.grid, parameters.max_distance)
    draws = generator(seed, "localisation/filter", "robot")
    first = Pose(*course.odometry[0].tolist())
    return Amcl(field, course.sensor, course.start if placed else None, draws, parameters, origin=first)


@lru_cache(maxsize=8)
def _field(grid: OccupancyGrid, max_distance: float) -> LikelihoodField:
    return likelihood_field(grid, max_distance)


def replay(course: Course, localisation: Localisation) -> EstimatedTrack:
    """Run a localisation on a course: a call per odometry pose, with the newest scan since the last call."""
    sweeps = OdometryBuffer(course.sensor)
    newest = np.searchsorted(course.stamps, course.instants, side="right") - 1
    poses = course.odometry.tolist()
    track = np.empty((len(poses), 13))
    costs = np.empty(len(poses))
    taken = -1
    for step, here in enumerate(poses):
        scan = None
        if newest[step] > taken:
            taken = int(newest[step])
            scan = Scan(int(course.stamps[taken]), course.scans[taken].astype("<u2").tobytes())
        sweep = sweeps.take(Instant(int(course.instants[step])), Pose(*here), scan)
        began = time.process_time_ns()
        estimate = localisation.update(Pose(*here), sweep)
        costs[step] = (time.process_time_ns() - began) / 1e9
        track[step] = *estimate.pose, *estimate.covariance, estimate.lost
    covariances = track[:, 3:12].reshape(-1, 3, 3)
    return EstimatedTrack(track[:, :3], covariances, track[:, 12], costs, localisation.outcome())


@dataclass(frozen=True, eq=False)
class FilterRun:
    """Errors of one run."""

    seed: int
    errors: Singles
    """(n,): position error at every odometry pose, m, without alignment."""
    turns: Singles
    """(n,): absolute heading error, rad."""
    nees: Singles
    """(n,): normalised estimation error squared; inf where the covariance is singular."""
    announced: Flags
    """(n,): whether the robot reports that it is lost."""
    costs: Singles
    """(m,): CPU time of the calls that weighed a scan, s."""
    outcome: dict[str, object]

    @property
    def rmse(self) -> float:
        """Root mean square error (absolute trajectory error), m."""
        return math.sqrt(self.mean_square)

    @property
    def mean_square(self) -> float:
        """Mean square error, m²."""
        return float(np.mean(np.square(self.errors, dtype=np.float64)))

    @property
    def tracking(self) -> Singles:
        """NEES of the steps with an error of at most BEYOND."""
        return self.nees[self.errors <= TRACKED]

    @property
    def spells(self) -> list[bool]:
        """True if the robot reported each lost interval."""
        lost = true_intervals(self.errors > LOST_ERROR, LOST_STEPS)
        return [bool(self.announced[begin:end].any()) for begin, end in lost]

    @property
    def false_alarms(self) -> int:
        """Number of reports while the robot was not lost."""
        starts = np.flatnonzero(np.diff(self.announced.astype(int)) > 0) + 1
        return sum(
            bool((self.errors[max(at - CLEAR_STEPS, 0) : at + CLEAR_STEPS] <= TRACKED).all())
            for at in starts.tolist()
        )

    @property
    def lost(self) -> bool:
        """True if the final error exceeds LOST."""
        return bool(self.errors[-1] > LOST_ERROR)

    def found(self, step: int) -> bool:
        """Return whether the errors are within FOUND at a step, or at the last one."""
        step = min(step, len(self.errors) - 1)
        return bool(self.errors[step] <= RELOCALISED[0] and self.turns[step] <= RELOCALISED[1])

    def figures(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        low, high = NEES_BOUNDS
        return {
            "seed": self.seed,
            "rmse": self.rmse,
            "median": float(np.median(self.errors)),
            "max": float(self.errors.max()),
            "share_beyond": float(np.mean(self.errors > TRACKED)),
            "end": float(self.errors[-1]),
            "lost": self.lost,
            "nees_median": finite(np.median(self.nees)),
            "nees_tracking": finite(np.median(self.tracking)) if self.tracking.size else None,
            "spells": len(self.spells),
            "spells_announced": sum(self.spells),
            "false_alarms": self.false_alarms,
            "nees_below": float(np.mean(self.nees < low)),
            "nees_above": float(np.mean(self.nees > high)),
            "updates": len(self.costs),
            "cpu_us_mean": finite(1e6 * self.costs.mean()) if self.costs.size else None,
            "cpu_us_min": finite(1e6 * self.costs.min()) if self.costs.size else None,
            "outcome": self.outcome,
        }


def errors_against_truth(seed: int, truth: Floats, odometry: Floats, track: EstimatedTrack) -> FilterRun:
    """Return the errors of a run. `truth`, `odometry`: (n, 3), m and rad."""
    errors = track.poses - truth
    errors[:, 2] -= math.tau * np.rint(errors[:, 2] / math.tau)
    return FilterRun(
        seed,
        np.hypot(errors[:, 0], errors[:, 1]).astype(np.float32),
        np.abs(errors[:, 2]).astype(np.float32),
        nees(errors, track.covariances).astype(np.float32),
        track.lost > REPORT_PROBABILITY,
        track.costs[weighed_calls(odometry, track.poses)].astype(np.float32),
        track.outcome,
    )


def weighed_calls(odometry: Floats, poses: Floats) -> Flags:
    """Return (n,): calls that changed the estimate beyond the odometry's motion; both arrays (n, 3)."""
    turn = poses[:, 2] - odometry[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    x = poses[:, 0] - c * odometry[:, 0] + s * odometry[:, 1]
    y = poses[:, 1] - s * odometry[:, 0] - c * odometry[:, 1]
    frame = np.column_stack([x, y, c, s])
    changed = np.ones(len(frame), np.bool_)
    changed[1:] = np.abs(np.diff(frame, axis=0)).max(axis=1) > 1e-9
    return changed


def nees(errors: Floats, covariances: Floats) -> Floats:
    """Return (n,) normalised estimation errors squared eᵀ P⁻¹ e of errors (n, 3), covariances (n, 3, 3).

    inf where P is not positive definite, even for an error of zero (Bar-Shalom, Li and
    Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4.2).
    """
    values = np.full(len(errors), math.inf)
    # scaled to a unit diagonal, since m² and rad² may differ by orders of magnitude
    scale = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    sound = (scale > 0).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    scale, unit = scale[sound], errors[sound] / scale[sound]
    correlation = covariances[sound] / (scale[:, :, None] * scale[:, None, :])
    definite = np.linalg.eigvalsh(correlation)[:, 0] > 1e-9
    solved = np.linalg.solve(correlation[definite], unit[definite][:, :, None])[:, :, 0]
    values[np.flatnonzero(sound)[definite]] = np.einsum("ij,ij->i", unit[definite], solved)
    return values


def finite(value: Any) -> float | None:
    """Return the value, or None if it is infinite or NaN, which JSON cannot express."""
    return float(value) if math.isfinite(value) else None
