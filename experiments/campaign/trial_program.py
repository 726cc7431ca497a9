"""One trial in a process of its own: `python -m … STUDY.json NUMBER OUT DIR…`, DIR with modules.

The record is written at the end and at once; a process that dies leaves none.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: a run has its own idea of processes

import sys
import traceback
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.errors import AcrcError, printable
from actors.runtime.lifecycle.parent import die_with_parent
from deploy.processes.robot_logs import EVERYBODY, shown
from deploy.processes.signals import Interrupted
from deploy.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scratch import scratch_folder
from experiments.accounting.account import account
from experiments.accounting.time_spent import TimeSpent
from experiments.campaign.trace import Trace
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.study.draws import drawn
from experiments.study.study import Study, Trial

T = TypeVar("T")


def main(argv: Sequence[str]) -> int:
    """Run the trial, and write down what came of it; the exit code."""
    die_with_parent(os.getppid())
    study_file, number, out, *modules = argv
    study, trial = trial_of(Path(study_file), int(number))
    keep(Path(out), record(study, trial, tuple(map(Path, modules))))
    return 0


def trial_of(study_file: Path, number: int) -> tuple[Study, Trial]:
    """The study in the file, and its trial of this number."""
    study = msgspec.json.decode(study_file.read_bytes(), type=Study)
    return study, next(islice(study.trials(), number, None))


def record(study: Study, trial: Trial, modules: tuple[Path, ...] = ()) -> TrialRecord:
    """The trial, run here; whatever goes wrong in it is what the record says. `modules`: as for a run."""
    settings, fault = attempted(lambda: drawn(study, trial))
    done: tuple[RunResult, TimeSpent, str] | None = None
    if settings is not None:
        of_all = settings
        done, fault = attempted(lambda: _run(study, trial, of_all, modules))
    result, time, trace = done or (None, None, "")
    variant = dict(trial.variant)
    return TrialRecord(trial.strategy, trial.seed, variant, result, fault, time, settings or {}, trace)


def attempted(work: Callable[[], T]) -> tuple[T | None, str | None]:
    """What `work` gives, or else why it came to no end, in a sentence."""
    try:
        return work(), None
    except (Interrupted, KeyboardInterrupt):
        raise
    except AcrcError as error:
        return None, printable(str(error))
    except BaseException as error:  # a strategy's own error, which in memory is raised here
        traceback.print_exc()
        notes = "; ".join(getattr(error, "__notes__", ()))
        return None, printable(f"{type(error).__name__}: {error}" + (f" ({notes})" if notes else ""))


def overrides_of(study: Study, trial: Trial, settings: dict[str, Any]) -> Overrides:
    """What of the scenario is other than in its file, `settings` being what was drawn."""
    return Overrides(
        seed=trial.seed,
        strategy=trial.strategy,
        settings=(*study.settings, *trial.variant, *settings.items()),
    )


def _run(
    study: Study, trial: Trial, settings: dict[str, Any], modules: tuple[Path, ...]
) -> tuple[RunResult, TimeSpent, str]:
    path = Path(study.scenario)
    with scratch_folder() as folder:
        options = RunOptions(folder / "out", bus="memory", json=True, scenario=path.name, modules=modules)
        plan = swarm.plan(load_scenario(path, overrides_of(study, trial, settings)), options)
        bus = MemoryBus()
        trace = Trace(bus)
        with shown(options.out, (EVERYBODY,)) as look:
            result = swarm.run_in_memory(plan, lambda progress: look(), bus)
        time = account(options.out)
    return msgspec.structs.replace(result, out=""), time, trace.text


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
