"""Result of a field trial, from its robots' recordings on one time axis."""

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
    laboratory that emulated the robots' devices.
    """
    ground_truth = None if truth is None else read_ground_truth(truth)
    trial = read_field_trial(folders)
    clocks = AlignedClocks(trial)
    places = reported_places(trial, clocks)
    if ground_truth is not None:
        places = with_ground_truth(places, ground_truth, clocks)
    result = field_trial_result(trial, clocks, places, out, ground_truth)
    if out is not None:
        make_folder(out)
        write_places(places.places, out / "places.csv")
        (out / "run.json").write_bytes(typed_json.dump(result))
        seal(out)
    return result
