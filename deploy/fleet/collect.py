"""Result of a field trial, from its robots' recordings on one time axis."""

from collections.abc import Sequence
from pathlib import Path

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import read_field_trial
from acrc_testbed.results.field_trial_result import field_trial_result, read_ground_truth
from acrc_testbed.results.outcome import write_items
from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import seal
from acrc_testbed.results.trial_judgement import judge_reports
from actors.runtime import typed_json
from deploy.run.out_folder import make_folder


def collect(folders: Sequence[Path], out: Path | None = None, truth: Path | None = None) -> RunResult:
    """Return the result of a field trial. Raises AcrcError if the folders are not of one field trial.

    `out`: new or empty folder for run.json, the table of items and their seal. `truth`: the result file of
    the laboratory that emulated the robots' devices.
    """
    ground_truth = None if truth is None else read_ground_truth(truth)
    trial = read_field_trial(folders)
    clocks = AlignedClocks(trial)
    judgement = judge_reports(trial, clocks, ground_truth)
    result = field_trial_result(trial, clocks, judgement, out, ground_truth)
    if out is not None:
        make_folder(out)
        task = judgement.declaration
        write_items(judgement.outcome.items, task.columns, out / f"{task.table}.csv")
        (out / "run.json").write_bytes(typed_json.dump(result))
        seal(out)
    return result
