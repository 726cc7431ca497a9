"""Process of one trial: `python -m … FOLDER`; the folder contains the trial's order.

The order has no information on the study: no number, campaign folder or other strategies, nor whether the
trial is a repetition. The record is written atomically at the end; a crashed process leaves none.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: runs are parallel themselves

import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from acrc_testbed.experiments.metrics import compute, needs_full_recording, read_tables
from acrc_testbed.experiments.trial_record import (
    ORDER_FILE,
    RECORD_FILE,
    TrialOrder,
    TrialRecord,
    pose_trace,
    write_json,
)
from acrc_testbed.experiments.trial_settings import draw_settings
from acrc_testbed.explanation.time_accounting import account_time
from acrc_testbed.explanation.time_spent import TimeSpent
from acrc_testbed.results.result import RunResult
from actors.processes.robot_logs import ALL_ROBOTS
from actors.processes.signals import Interruption
from actors.runtime.errors import AcrcError, printable
from actors.runtime.linux import die_with_parent
from actors.user_code import set_folders, set_task_folders
from deploy.run.options import RunOptions
from deploy.run.start import PreparedRun, start_run
from deploy.scenario.scenario_file import Overrides, load_scenario

T = TypeVar("T")


def main(argv: Sequence[str]) -> int:
    """Run the trial and write its record; return the exit code."""
    die_with_parent(os.getppid())
    (name,) = argv
    folder = Path(name)
    order = msgspec.json.decode((folder / ORDER_FILE).read_bytes(), type=TrialOrder)
    record = run_trial_order(order, folder / "run")
    for one in with_metrics(record, order, folder / "run"):
        write_json(folder / RECORD_FILE, one)
    return 0


def run_trial_order(order: TrialOrder, out: Path) -> TrialRecord:
    """Run the trial in this process into the folder `out`; the record contains any failure."""
    set_task_folders([Path(one) for one in order.task_modules])
    trial = order.trial
    settings, fault = attempt(partial(draw_settings, order.study, trial))
    done = None
    if settings is not None:
        done, fault = attempt(partial(_run, order, settings, out))
    result, time, seconds = done or (None, None, "")
    return TrialRecord(
        strategy=trial.strategy,
        seed=trial.seed,
        variant={},
        result=result,
        failure=fault,
        time=time,
        drawn=settings or {},
        trace=seconds,
    )


def with_metrics(record: TrialRecord, order: TrialOrder, out: Path) -> Iterator[TrialRecord]:
    """Yield the record with the study's own metrics of the run in `out`, after each metric.

    A metric counts as failed until it is computed, so that it may end or block this process.
    """
    own, result = order.study.metric, record.result
    if result is None or not own:
        yield record
        return
    set_folders([Path(one) for one in (*order.modules, *order.metric_modules)])
    values: dict[str, float | None] = {}
    faults = {one.name: "the process of the trial exited while the metric was computed" for one in own}
    tables, unread = attempt(lambda: read_tables(out))
    for one in (None, *own):
        if one is not None:
            value, fault = (None, unread) if tables is None else attempt(partial(compute, one, tables))
            if fault is None:
                values[one.name] = value
                del faults[one.name]
            else:
                faults[one.name] = fault
        measured = msgspec.structs.replace(result, metrics=dict(values), metric_faults=dict(faults))
        yield msgspec.structs.replace(record, result=measured)


def attempt(work: Callable[[], T]) -> tuple[T | None, str | None]:
    """Return the result of `work`, or None and a sentence on its failure."""
    try:
        return work(), None
    except (Interruption, KeyboardInterrupt):
        raise
    except AcrcError as error:
        return None, printable(str(error))
    except BaseException as error:  # in memory, errors of strategies are raised here
        traceback.print_exc()
        notes = "; ".join(getattr(error, "__notes__", ()))
        return None, printable(f"{type(error).__name__}: {error}" + (f" ({notes})" if notes else ""))


def _run(order: TrialOrder, settings: dict[str, Any], out: Path) -> tuple[RunResult, TimeSpent, str]:
    path = Path(order.study.scenario)
    overrides = Overrides(
        seed=order.trial.seed,
        strategy=order.trial.strategy,
        settings=(*order.study.settings, *settings.items()),
    )
    options = RunOptions(
        out, bus=order.bus, isolate=order.isolate, json=True, scenario=path.name, hidden=(path,),
        log=(ALL_ROBOTS,), modules=tuple(map(Path, order.modules)),
        record="full" if needs_full_recording(order.study.metric) else "lean",
    )  # fmt: skip
    result = start_run(PreparedRun(load_scenario(path, overrides), options), quiet=True)
    return msgspec.structs.replace(result, out=""), account_time(out), pose_trace(out)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
