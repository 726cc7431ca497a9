"""Result of a field trial from the recordings of its robots, on one time axis."""

from collections.abc import Sequence
from pathlib import Path

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import read_field_trial
from acrc_testbed.results.field_trial_result import (
    field_trial_result,
    read_ground_truth,
    reported_places,
    with_ground_truth,
)
from acrc_testbed.results.outcome import write_places
from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import seal
from actors.runtime import typed_json
from deploy.run.out_folder import make_folder


def collect(folders: Sequence[Path], out: Path | None = None, truth: Path | None = None) -> RunResult:
    """Return the result of a field trial. Raises AcrcError if the folders are not of one field trial.

    `out`: new or empty folder for run.json, places.csv and their seal. `truth`: the result file of the
    laboratory in which the robots were.
    """
    true = None if truth is None else read_ground_truth(truth)
    trial = read_field_trial(folders)
    clocks = AlignedClocks(trial)
    told = reported_places(trial, clocks)
    if true is not None:
        told = with_ground_truth(told, true, clocks)
    result = field_trial_result(trial, clocks, told, out, true)
    if out is not None:
        make_folder(out)
        write_places(told.places, out / "places.csv")
        (out / "run.json").write_bytes(typed_json.dump(result))
        seal(out)
    return result
