"""One trial once more, as real processes over Zenoh: `python -m … STUDY.json NUMBER RECORD OUT DIR…`."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from actors.runtime.lifecycle.parent import die_with_parent
from deploy.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from deploy.scratch import scratch_folder
from experiments.campaign.trial_program import attempted, overrides_of, trial_of
from experiments.campaign.trial_record import CheckRecord, TrialRecord, keep
from experiments.study.study import Study, Trial


def main(argv: Sequence[str]) -> int:
    """Repeat the trial whose record is given, and write down whether it gives the same; the exit code."""
    die_with_parent(os.getppid())
    study_file, number, before, out, *modules = argv
    study, trial = trial_of(Path(study_file), int(number))
    first = msgspec.json.decode(Path(before).read_bytes(), type=TrialRecord)
    keep(Path(out), repeated(study, trial, first, tuple(map(Path, modules))))
    return 0


def repeated(study: Study, trial: Trial, before: TrialRecord, modules: tuple[Path, ...] = ()) -> CheckRecord:
    """The trial over Zenoh beside what it was in memory; it must have a result."""
    first = before.result
    assert first is not None
    again, failure = attempted(lambda: _run(study, trial, before, modules))
    here = CheckRecord(
        trial.strategy, trial.seed, before.variant, first.digest, first.real_time_factor, failure=failure
    )
    if again is None:
        return here
    return msgspec.structs.replace(here, over_zenoh=again.digest, over_zenoh_speed=again.real_time_factor)


def _run(study: Study, trial: Trial, before: TrialRecord, modules: tuple[Path, ...]) -> RunResult:
    path = Path(study.scenario)
    with scratch_folder() as folder:
        options = RunOptions(
            folder / "out", bus="zenoh", json=True, scenario=path.name, hidden=(path,), modules=modules
        )
        return swarm.run(load_scenario(path, overrides_of(study, trial, before.drawn)), options)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
