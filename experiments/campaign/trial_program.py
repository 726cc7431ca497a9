"""One trial in a process of its own: `python -m … STUDY.json NUMBER OUT`.

The record is written at the end and at once; a process that dies leaves none.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: a run has its own idea of processes

import sys
import tempfile
import traceback
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import msgspec

from actors.runtime.errors import AcrcError, printable
from actors.runtime.lifecycle.parent import die_with_parent
from deploy.processes.signals import Interrupted
from deploy.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from experiments.accounting.account import account
from experiments.accounting.time_spent import TimeSpent
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.study.study import Study, Trial


def main(argv: Sequence[str]) -> int:
    """Run the trial, and write down what came of it; the exit code."""
    die_with_parent(os.getppid())
    study_file, number, out = argv
    study = msgspec.json.decode(Path(study_file).read_bytes(), type=Study)
    trial = next(islice(study.trials(), int(number), None))
    keep(Path(out), record(study, trial))
    return 0


def record(study: Study, trial: Trial) -> TrialRecord:
    """The trial, run here; whatever goes wrong in it is what the record says."""
    result, time, failure = None, None, None
    try:
        result, time = _run(study, trial)
    except (Interrupted, KeyboardInterrupt):
        raise
    except AcrcError as error:
        failure = str(error)
    except BaseException as error:  # a strategy's own error, which in memory is raised here
        traceback.print_exc()
        notes = "; ".join(getattr(error, "__notes__", ()))
        failure = f"{type(error).__name__}: {error}" + (f" ({notes})" if notes else "")
    told = None if failure is None else printable(failure)
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), result, told, time)


def _run(study: Study, trial: Trial) -> tuple[RunResult, TimeSpent]:
    overrides = Overrides(
        seed=trial.seed, strategy=trial.strategy, settings=(*study.settings, *trial.variant)
    )
    path = Path(study.scenario)
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus="memory", json=True, scenario=path.name)
        result = swarm.run(load_scenario(path, overrides), options)
        time = account(options.out)
    return msgspec.structs.replace(result, out=""), time


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
