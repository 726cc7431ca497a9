"""Gap between a field trial and a simulated run of the same scenario, and the keys that reduce it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.experiments.paired_tests import ALPHA, NO_TEST, PairedTest, decidable, holm, mean_test
from acrc_testbed.experiments.reality_gap import Quantity, quantities
from acrc_testbed.experiments.scan_poses import ScanMatcher
from acrc_testbed.recordings.run_recordings import read_setup, recordings
from acrc_testbed.results.field_recordings import UNNAMED_TASK, FieldTrialError, read_field_trial
from acrc_testbed.run_model.data import RunDataError
from acrc_testbed.run_model.hardware_runs import trial_map
from acrc_testbed.run_model.recording_readers import world_setup
from actors.array_types import Floats
from actors.floor.map_file import load_map
from actors.radio.radio_model import RadioModel, RadioSetup, radio_model
from actors.robot_model import RobotModel, load_model

MIN_BLOCKS: Final = 8
"""Fewest blocks of each side for an estimate; own choice."""
_RESAMPLES: Final = 2000
TOO_LITTLE: Final = "too little data"


class QuantityGap(msgspec.Struct, frozen=True):
    """A quantity in field and simulation; NaN, in JSON null: too little data."""

    name: str
    unit: str
    field: float
    simulated: float
    difference: float
    """Field minus simulation."""
    interval: list[float] | None
    """95 % interval of the difference, by bootstrap over blocks; None: too little data."""
    blocks: tuple[int, int]
    """Blocks of the field and the simulation."""


class KeyFit(msgspec.Struct, frozen=True):
    """A key of the scenario or robot model, fitted on every other block of the trial, judged on the rest."""

    key: str
    unit: str
    simulated: float
    """Its value in the simulated run."""
    fitted: float
    """NaN, in JSON null: too little data."""
    interval: list[float] | None
    """95 % interval, by bootstrap over blocks; None: too little data."""
    p: float | None
    """P-value of no improvement on the other half, adjusted for all keys (Holm); None: too little data."""
    verdict: str
    """`nearer`: the value reduces the error of the other half significantly, by a difference that is worth
    reporting. Otherwise the reason why not."""


class GapReport(msgspec.Struct, frozen=True):
    """Result of a comparison of a field trial with a simulated run."""

    robots: tuple[str, ...]
    quantities: tuple[QuantityGap, ...]
    keys: tuple[KeyFit, ...]
    notes: tuple[str, ...]


class FittedKey(NamedTuple):
    """A key whose change shifts a quantity by as much."""

    quantity: str
    key: str
    simulated: float
    least: float
    """Least difference worth reporting; own choice."""


def compare_field(field: Path, run: Path) -> GapReport:
    """Compare the recordings of a field trial with those of a simulated run. Raises an AcrcError."""
    files = recordings(run)
    if missing := {"world", "radio"} - set(files):
        raise RunDataError(f"{run}: no recording of the {max(missing)}; RUN must be a simulated run")
    world = world_setup(files["world"])
    setup = read_setup(files["radio"], RadioSetup, "a radio").resolve_paths(files["radio"].parent)
    trial, simulation = (read_field_trial([one], senses=True) for one in (field, run))
    if trial.task is not UNNAMED_TASK and trial.task.use != world.task.use:
        raise FieldTrialError(
            f"{field}: the task is {trial.task.use!r}, but {world.task.use!r} in {run}; "
            "simulate the scenario of the field trial"
        )
    models = {one.id: load_model(one.model, one.sensor) for one in world.robots if one.id in trial.logs}
    if not models:
        raise FieldTrialError(
            f"{field}: its robots are {', '.join(trial.logs)}, those of {run} {', '.join(world.ids)}; "
            "at least one must be in both"
        )
    grid, notes = trial_map(trial)
    plan = load_map(Path(world.map))
    if not notes and not (grid.origin == plan.origin and np.array_equal(grid.cells, plan.cells)):
        raise FieldTrialError(f"{field}: its map differs from that of {run}; simulate the map of the trial")
    model = next(iter(models.values()))
    robots = tuple(robot for robot, one in models.items() if one == model)
    if len(robots) < len(models):
        notes = (*notes, f"only robots of the model {model.name!r} are compared: {', '.join(robots)}")
    radio = radio_model(msgspec.structs.replace(setup, shadowing_db=0.0))
    matcher = ScanMatcher(plan, model)
    simulated = quantities(simulation, robots, matcher, model.drive, radio)
    measured = quantities(trial, robots, matcher, model.drive, radio, simulated["command delay"].best())
    return GapReport(
        robots,
        tuple(_gap(one, simulated[name]) for name, one in measured.items()),
        tuple(key_fits(measured, simulated, compared_keys(model, radio))),
        (*trial.notes, *notes),
    )


def _bootstrap(quantity: Quantity, seed: int) -> Floats:
    """Return the quantity of bootstrap samples of its blocks."""
    count = len(quantity.blocks)
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), _RESAMPLES)
    return quantity.estimate(drawn.astype(np.float64))


def _interval(samples: Floats) -> list[float]:
    return list(np.nanquantile(samples, (0.025, 0.975)).tolist())


def _gap(field: Quantity, simulated: Quantity) -> QuantityGap:
    sides = field, simulated
    one, other = (side.total() if len(side.blocks) >= MIN_BLOCKS else np.nan for side in sides)
    interval = None
    if not np.isnan(one - other):
        interval = _interval(_bootstrap(field, 1) - _bootstrap(simulated, 2))
    blocks = len(field.blocks), len(simulated.blocks)
    return QuantityGap(field.name, field.unit, one, other, one - other, interval, blocks)


def compared_keys(model: RobotModel, radio: RadioModel) -> list[FittedKey]:
    """Return the keys with their values in the simulation."""
    drive, excess_db = model.drive, radio.parameters.propagation.path_loss.excess_db
    straight, turn = drive.acceleration, drive.turn_acceleration
    return [
        FittedKey("speed limit", "drive.speed", drive.speed, 0.05 * drive.speed),
        FittedKey("acceleration", "drive.acceleration", straight, 0.15 * straight),
        FittedKey("turn acceleration", "drive.turn_acceleration", turn, 0.15 * turn),
        FittedKey("command delay", "drive.delay", drive.delay, 0.02),
        FittedKey("scan residual", f"sensors.{model.default_sensor}.noise", model.sensor.noise, 0.002),
        FittedKey("odometry scale", "kobuki_errors.wheel_bias", model.kobuki_errors.wheel_bias, 0.005),
        FittedKey("path loss beyond the model", "radio.excess_db", excess_db, 1.0),
    ]


def key_fits(
    field: Mapping[str, Quantity], simulated: Mapping[str, Quantity], keys: list[FittedKey]
) -> Iterator[KeyFit]:
    """Yield the fit of each key, with p-values adjusted for all keys that can be decided."""
    fits = [_fit(field[one.quantity], simulated[one.quantity], one.simulated) for one in keys]
    able = decidable([test.differing for *_, test in fits])
    adjusted = iter(holm([test.p for (*_, test), is_able in zip(fits, able, strict=True) if is_able]))
    for one, (value, interval, test), is_able in zip(keys, fits, able, strict=True):
        p, verdict = next(adjusted) if is_able else None, "nearer"
        if abs(value - one.simulated) < one.least:
            verdict = "as simulated"
        elif p is None:
            verdict = TOO_LITTLE
        elif p >= ALPHA or test.direction < 0:
            verdict = "not significant"
        yield KeyFit(one.key, field[one.quantity].unit, one.simulated, value, interval, p, verdict)


def _fit(
    field: Quantity, simulated: Quantity, setting: float
) -> tuple[float, list[float] | None, PairedTest]:
    """Return the value of a key, its interval, and the test of the improvement of the other half.

    `setting`: the key's value in the simulation.
    """
    if min(len(field.blocks), len(simulated.blocks)) < MIN_BLOCKS:
        return np.nan, None, NO_TEST
    half = field._replace(blocks=field.blocks[::2])
    totals = simulated.total(), half.total()
    errors = [np.interp(totals, field.candidates, block) for block in field.blocks[1::2]]
    before, after = np.transpose(errors)
    shift = setting - totals[0]
    return totals[1] + shift, _interval(_bootstrap(half, 1) + shift), mean_test(before - after)
