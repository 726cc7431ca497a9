"""Quantities of a field trial or a simulated run, computed from the robots' own recordings alone.

Each quantity is a sum over blocks of a robot's time, so that blocks can be resampled and split into halves:
a ratio of two sums, or the candidate with the least sum of absolute prediction errors.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from acrc_testbed.experiments.scan_poses import MAX_PAUSE_S, Keyframe, ScanMatcher
from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import FieldTrial, FieldTrialError, RobotLog
from acrc_testbed.run_model.hardware_runs import TrialClock
from acrc_testbed.run_model.recording_readers import robot_report
from actors.array_types import Floats
from actors.messages import Drive
from actors.radio.radio_model import RadioModel
from actors.robot_model import DriveParameters

BLOCK_S: Final = 5.0
"""Length of a block, s; own choice: blocks are nearly independent."""
_SUBSTEP_S: Final = 0.01
_HISTORY: Final = 3
"""Greatest delay of a command, in steps."""
_MOVING: Final = 0.05
"""Command above which a robot moves, m/s or rad/s; own choice."""
_FACTORS: Final = 1.03 ** np.arange(-40, 41, dtype=np.float64)
"""Candidates for accelerations, 0.3 to 3.3 times that of the simulation."""
_FLOOR: Final = 0.05
"""Error of a block from the resolution of odometry, m/s or rad/s: 1 mm/s per step; own choice."""
_PENALTY: Final = 0.1
"""Least reduction of an error, as a share, that justifies another value than that of the simulation; own
choice."""
_MAX_LATENCY_S: Final = 1.0
"""Maximum time from the end of a transmission to its reception, after alignment of clocks, s."""
_WEAKEST_DBM: Final = -90.0
"""Least signal strength that a transceiver reports (MRF24J40, DS39776C, table 3-8)."""
_DISTANCES: Final = (0.0, 2.0, 4.0, 8.0, 16.0, np.inf)
"""Bounds of the bins of frames by distance, m."""
_LOSSES_DB: Final = np.arange(-20.0, 20.01, 0.25, np.float64)
_SCALES: Final = np.arange(0.9, 1.1001, 0.001, np.float64)
_NOISES: Final = 0.0003 * 1.07 ** np.arange(100, dtype=np.float64)
"""Candidates, 0.0003 to 0.24 m."""
_MEDIAN: Final = 0.6745
"""Median of the absolute value of a normal variable with standard deviation 1."""


class Quantity(NamedTuple):
    """One quantity; `estimate` computes it from any selection of its blocks."""

    name: str
    unit: str
    blocks: Floats
    """(n, 2): numerator and denominator; with candidates (n, g): error of each block for each."""
    candidates: Floats = np.zeros(0)
    """(g,), ascending; empty: the quantity is a ratio."""

    def estimate(self, weights: Floats) -> Floats:
        """Return the quantity, (k,), with blocks weighted by (k, n); NaN: its denominator is 0."""
        sums: Floats = weights @ self.blocks
        if not len(self.candidates):
            sums[sums[:, 1] == 0] = np.nan
            return np.asarray(sums[:, 0] / sums[:, 1], np.float64)
        numbers = np.arange(len(self.candidates))
        best = sums.argmin(axis=1).clip(1, len(numbers) - 2)
        low, least, high = np.take_along_axis(sums, np.add.outer(best, (-1, 0, 1)), axis=1).T
        curvature = np.fmax(low - 2 * least + high, 1e-12)  # may be negative if the best is the first or last
        vertex = best + (low - high) / (2 * curvature)
        return np.asarray(np.interp(vertex, numbers, self.candidates), np.float64)

    def total(self) -> float:
        """Return the quantity of all blocks."""
        return float(self.estimate(np.ones((1, len(self.blocks))))[0])

    def best(self) -> float:
        """Return the best candidate of every other block."""
        return float(self.candidates[self.blocks[::2].sum(axis=0).argmin()])


def drive_blocks(logs: Sequence[RobotLog]) -> Floats:
    """Return the blocks without pressed bumper, missing answer or skipped step in which a robot moves.

    (b, _HISTORY + steps + 1, 4): commanded velocities, m/s and rad/s, and those by odometry. The rows begin
    before the block. `logs`: with sensor data, of equal step.
    """
    steps = max(1, round(BLOCK_S * 1e6 / logs[0].identity.step_us))
    found = []
    for log in logs:
        orders = np.full((len(log.ticks), 2), np.nan)
        for tick, drive in log.messages_of(Drive):
            orders[tick] = drive.vx, drive.omega
        rows = [(one.odometry.vx, one.odometry.omega, one.bumper) for one in log.senses or ()]
        *reached, bumper = np.transpose(rows)
        orders[bumper > 0] = np.nan
        orders[1:][np.diff([tick.step for tick in log.ticks]) != 1] = np.nan
        both = np.column_stack((orders, *reached))
        for begin in range(0, len(both) - steps - _HISTORY, steps):
            block = both[begin : begin + _HISTORY + steps + 1]
            if np.abs(block[:-1, :2]).max() > _MOVING:  # false with NaN
                found.append(block)
    return np.reshape(found, (-1, _HISTORY + steps + 1, 4))


def drive_errors(
    blocks: Floats, step_us: int, accelerations: Floats, delays: Floats, limits: Floats | float
) -> Floats:
    """Return the summed absolute error of predicted velocities of each block, (b, a, d).

    The model: wheels follow the command, limited to ±limit, after a delay, s, with limited acceleration. The
    candidates are broadcast. blocks (b, _HISTORY + steps + 1, 2): commanded and reached.
    """
    per_step = max(1, round(step_us * 1e-6 / _SUBSTEP_S))
    orders, reached = np.repeat(blocks[..., 0], per_step, axis=1), blocks[..., 1, None, None]
    velocity = reached[:, _HISTORY] + np.zeros(np.broadcast(accelerations, delays, limits).shape)
    errors, change = np.zeros_like(velocity), accelerations * _SUBSTEP_S
    late = np.atleast_2d(np.rint(delays / _SUBSTEP_S).astype(np.int64))
    for number in range(_HISTORY * per_step, (blocks.shape[1] - 1) * per_step):
        target = np.clip(orders[:, number - late], -limits, limits)
        velocity += np.clip(target - velocity, -change, change)
        if (number + 1) % per_step == 0:
            errors += np.abs(velocity - reached[:, (number + 1) // per_step])
    return errors


def drive_quantities(
    logs: Sequence[RobotLog], drive: DriveParameters, delay: float = np.nan
) -> Iterator[Quantity]:
    """Yield speeds, and the fitted limits and delay of the drive.

    Short ramps hardly tell acceleration from delay. So each is fitted with the others' values of the
    simulation, `drive` and `delay`, unless another value reduces the error by more than a penalty. These
    values are found with every other block. Without `delay` the blocks are the simulation's.
    """
    blocks, step_us = drive_blocks(logs), logs[0].identity.step_us
    orders, reached = np.abs(blocks[:, _HISTORY:-1, 0]), np.abs(blocks[:, _HISTORY + 1 :, 2])
    moving = orders > _MOVING
    for name, speeds in (("commanded", orders), ("reached", reached)):
        sums = (speeds * moving).sum(axis=1), moving.sum(axis=1)
        yield Quantity(f"mean speed {name}", "m/s", np.column_stack(sums))
    delays = np.arange(0.0, _HISTORY * step_us * 1e-6 + 1e-9, _SUBSTEP_S, np.float64)
    limits = np.arange(0.02, 1.01, 0.02, np.float64) * drive.speed
    grids = np.outer((drive.acceleration, drive.turn_acceleration), _FACTORS)
    changed = (1e9 if np.isnan(delay) else _PENALTY) * (_FACTORS != 1.0)[:, None]
    penalties = changed[:, None] + changed + _PENALTY * (np.abs(delays - delay) > _SUBSTEP_S / 2)
    straight, turning = (partial(drive_errors, blocks[..., axis::2], step_us) for axis in (0, 1))
    turns, limit = turning(grids[1][:, None], delays, drive.turn_rate), limits[-1]
    for _ in range(2):  # the speed limit needs the other values, which need the limit
        lines = straight(grids[0][:, None], delays, limit)
        one, other = (each[::2].sum(axis=0) + _FLOOR * (len(blocks) + 1) for each in (lines, turns))
        cost = np.log(one)[:, None] + np.log(other) + penalties
        line, turn, late = np.unravel_index(cost.argmin(), cost.shape)
        by_limit = straight(grids[0][line], delays[late], limits[:, None])[..., 0]
        by_limit -= 1e-9 * limits  # the highest of equal ones: commands may not reach the limit
        limit = limits[by_limit[::2].sum(axis=0).argmin()]
    yield Quantity("speed limit", "m/s", by_limit, limits)
    yield Quantity("acceleration", "m/s²", lines[..., late], grids[0])
    yield Quantity("turn acceleration", "rad/s²", turns[..., late], grids[1])
    by_delay = lines[:, line] / one[line, late] + turns[:, turn] / other[turn, late]
    yield Quantity("command delay", "s", by_delay, delays)


def _by_block(blocks: Floats, rows: Floats) -> Floats:
    """Return the sums of rows (n, k) by block; `blocks` (n, …): numbers that identify one."""
    numbers, index = np.unique(blocks, axis=0, return_inverse=True)
    sums = np.zeros((len(numbers), rows.shape[1]))
    np.add.at(sums, index.ravel(), rows)
    return sums


def scan_quantities(by_robot: Sequence[Sequence[Keyframe]]) -> Iterator[Quantity]:
    """Yield the residuals of scans, and errors of the odometry between keyframes."""
    numbered = [(robot, one) for robot, frames in enumerate(by_robot) for one in frames]
    rows = [
        (robot, a.second // BLOCK_S, *np.abs(np.abs(a.residuals)[:, None] - _MEDIAN * _NOISES).mean(axis=0))
        for robot, a in numbered
    ]
    blocks, errors = np.hsplit(np.reshape(rows, (-1, 2 + len(_NOISES))), (2,))
    yield Quantity("scan residual", "m", _by_block(blocks, errors), _NOISES)
    rows = [
        (robot, a.second // BLOCK_S, *a.odometry.relative(b.odometry)[:2], *a.pose.relative(b.pose)[:2])
        for (robot, a), (other, b) in pairwise(numbered)
        if robot == other and b.second - a.second <= MAX_PAUSE_S
    ]
    blocks, measured, true = np.hsplit(np.reshape(rows, (-1, 6)), 3)
    reached, driven, wrong = (np.hypot(*one.T)[:, None] for one in (measured, true, measured - true))
    yield Quantity("odometry scale", "", _by_block(blocks, np.abs(reached - driven * _SCALES)), _SCALES)
    yield Quantity("odometry drift", "m/m", _by_block(blocks, np.hstack((wrong, driven))))


def _receptions(
    logs: Sequence[RobotLog], clocks: Sequence[TrialClock], frames: Sequence[Sequence[Keyframe]]
) -> Iterator[tuple[float, ...]]:
    """Yield a row for each confirmed frame and each other robot, at places found by scans.

    Second, x and y of the sender, x and y of the receiver, m, and RSSI, dBm; NaN: not heard.
    """
    tracks = [np.reshape([(one.second, *one.pose[:2]) for one in each], (-1, 3)) for each in frames]

    def place(robot: int, second: float) -> list[float]:
        seconds, *track = tracks[robot].T
        is_near = len(seconds) and np.abs(seconds - second).min() < MAX_PAUSE_S
        return [np.interp(second, seconds, one) if is_near else np.nan for one in track]

    heard = defaultdict(list)
    for robot, log in enumerate(logs):
        for _, event in log.received_frames():
            second = clocks[robot].instant(event.instant) / 1e6
            heard[robot, event.sender, event.data].append((second, event.rssi_dbm))
    for sender, log in enumerate(logs):
        for frame in log.sent_frames():
            second = np.inf if frame.sent is None else clocks[sender].instant(frame.sent.instant) / 1e6
            for receiver, other in enumerate(logs):
                ticks = clocks[receiver].ticks
                if other.identity.id != log.identity.id and ticks[0] <= second <= ticks[-1]:
                    copies = heard[receiver, log.identity.address, frame.data]
                    rssi = (dbm for at, dbm in copies if abs(at - second) < _MAX_LATENCY_S)
                    yield second, *place(sender, second), *place(receiver, second), next(rssi, np.nan)


def radio_quantities(receptions: Floats, model: RadioModel) -> Iterator[Quantity]:
    """Yield the share of frames heard by distance, and the loss beyond that of the model.

    `receptions`: (n, 6), as of `_receptions`, at known places.
    """
    distances, heard = np.hypot(*(receptions[:, 1:3] - receptions[:, 3:5]).T), np.isfinite(receptions[:, 5])
    blocks = receptions[:, :1] // BLOCK_S
    for low, high in pairwise(_DISTANCES):
        near = (distances >= low) & (distances < high)
        reach = f"{low:g} to {high:g} m" if high < np.inf else f"above {low:g} m"
        rows = np.column_stack((heard, near))[near]
        yield Quantity(f"frames heard, {reach}", "", _by_block(blocks[near], rows))
    known = receptions[heard]
    losses = [model.propagation.loss_db(one[None, 1:3], one[None, 3:5]).item() for one in known]
    expected = model.parameters.transceiver.tx_power_dbm - np.reshape(losses, (-1, 1))
    errors = np.abs(known[:, 5:] - np.maximum(expected - _LOSSES_DB, _WEAKEST_DBM))
    yield Quantity("path loss beyond the model", "dB", _by_block(blocks[heard], errors), _LOSSES_DB)


def goal_quantity(logs: Sequence[RobotLog]) -> Quantity:
    """Return the driving time, also to aborted goals, per goal reached. Raises RecordingError."""
    rows = [
        ((goal.end - goal.begin) / 1e6, float(goal.how in ("succeeded", "replaced")))
        for goal in robot_report([log.path for log in logs]).goals or ()
        if goal.end is not None
    ]
    return Quantity("time per goal", "s", np.reshape(rows, (-1, 2)))


def quantities(
    trial: FieldTrial,
    robots: Sequence[str],
    matcher: ScanMatcher,
    drive: DriveParameters,
    radio: RadioModel,
    delay: float = np.nan,
) -> dict[str, Quantity]:
    """Return all quantities of these robots, of one model, by name.

    `trial`: with sensor data; `delay`: of the simulation, NaN: this is the simulation, as are the models.
    Raises an AcrcError for contradictory recordings.
    """
    aligned = AlignedClocks(trial)
    logs = [log for robot in robots for log in trial.logs[robot] if log.ticks]
    if not logs:
        raise FieldTrialError(f"{', '.join(robots)}: took no step in one of the recordings; repeat that run")
    clocks = [TrialClock(log, aligned) for log in logs]
    frames = [matcher.keyframes(log, clock) for log, clock in zip(logs, clocks, strict=True)]
    receptions = np.reshape(list(_receptions(logs, clocks, frames)), (-1, 6))
    placed = np.isfinite(receptions[:, 1:5]).all(axis=1)
    found = (
        *drive_quantities(logs, drive, delay),
        goal_quantity(logs),
        *scan_quantities(frames),
        *radio_quantities(receptions[placed], radio),
    )
    return {one.name: one for one in found}
