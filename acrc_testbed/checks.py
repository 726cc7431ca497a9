"""API tests of user code: `check_strategy` and `check_task` return findings."""

import inspect
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.recordings.record_replay import RecheckError, recheck
from acrc_testbed.results.result import RunResult
from acrc_testbed.shipped import file_of
from actors.instant import Instant, milliseconds
from actors.messages import Drive
from actors.robot.behaviour.code_permit import permit_of
from actors.robot.behaviour.loading import entry_function
from actors.runtime.errors import AcrcError
from actors.task.task import Task
from actors.user_code import set_folders
from cleaning.place import VisitReport
from cleaning.strategies import entry
from deploy.run.options import RunOptions
from deploy.run.start import PreparedRun, prepare_run, start_run
from deploy.run.swarm_replay import divergence
from deploy.scenario.scenario_file import Overrides
from deploy.scenario.tables import EventTable

_EVENTS: Final = (
    EventTable(at=2.0, freeze="r1"),
    EventTable(at=3.0, thaw="r1"),
    EventTable(at=4.0, restart="r2"),
    EventTable(at=5.0, lose="r1", of="r2"),
)
"""Disturbances that a strategy must handle: missed steps, a restart with empty state, a lost frame."""
_DROPPED: Final = ("frames_dropped", "frames_overflow")
_STEPS: Final = 50


def check_strategy(
    strategy: str,
    *,
    scenario: str | PathLike[str] = "head_on",
    duration: float = 20.0,
    settings: Mapping[str, object] | None = None,
    modules: Sequence[str | PathLike[str]] = (),
) -> list[str]:
    """Check a strategy, named as for `acrc run --strategy`, and return findings as sentences.

    Short in-memory runs check its function and types, message sizes, purity (a second run in the same
    process and a replay with another hash seed send the same messages), picklable set-up, frozen steps, a
    restart with empty state, lost frames, lost places, and its outcome.

    `settings`: values of the table [strategy]; `scenario`: must have the robots r1 and r2; `duration`: s, at
    least 10. Raises AcrcError for wrong arguments.
    """
    if duration < 10:
        raise AcrcError(f"duration: {duration:g} s is too short for the disturbances; use at least 10 s")
    overrides = Overrides(
        strategy=strategy,
        duration=duration,
        settings=tuple((f"strategy.{name}", value) for name, value in (settings or {}).items()),
    )
    permit = permit_of([Path(folder) for folder in modules], trust=False)
    with tempfile.TemporaryDirectory(prefix="acrc-check-") as name:
        folder = Path(name)
        options = RunOptions(folder / "first", bus="memory", json=True)
        prepared = prepare_run(file_of("scenarios", scenario), overrides, options, permit)
        set_folders(prepared.options.modules)
        if findings := [*_function_findings(strategy)]:
            return findings
        return [*_run_findings(prepared, folder)]


def _function_findings(strategy: str) -> Iterator[str]:
    """Yield faults of the function that creates the behaviour."""
    try:
        function = entry_function(entry(strategy))
    except AcrcError as error:
        yield str(error)
        return
    try:
        inspect.signature(function).bind(None)
    except TypeError as error:
        yield f"{strategy} cannot be called with a Start as its only argument: {error}"


def _run_findings(prepared: PreparedRun, folder: Path) -> Iterator[str]:
    """Run twice undisturbed, replay, run with disturbances; yield the faults found."""
    first = _run(prepared, folder / "first")
    if isinstance(first, str):
        yield first
        return
    yield from _result_findings(first)
    second = _run(prepared, folder / "second")
    if isinstance(second, str):
        yield f"a second run in the same process failed: {second}"
    elif second.digest != first.digest:
        step_us = int(milliseconds(prepared.scenario.run.step_ms))
        found = divergence(folder / "first", folder / "second", step_us, ("first run", "second run"))
        yield (
            "a second run in the same process differs: the strategy depends on a clock, its own random "
            f"numbers, or state outside its knowledge{f' ({found.words})' if found else ''}"
        )
    try:
        recheck(folder / "first", prepared.options.modules)
    except RecheckError as error:
        yield str(error)
    events = (*prepared.scenario.event, *_EVENTS)
    disturbed = prepared._replace(scenario=msgspec.structs.replace(prepared.scenario, event=events))
    third = _run(disturbed, folder / "disturbed")
    if isinstance(third, str):
        yield f"run with frozen and restarted robots and a lost frame: {third}"
    elif third.places_lost:
        yield (
            f"after a restart {third.places_lost} places are in no robot's route; "
            "a restarted robot should plan to visit its own places again"
        )


def _run(prepared: PreparedRun, out: Path) -> RunResult | str:
    """Return the result of an in-memory run, or its error message."""
    try:
        return start_run(prepared._replace(options=replace(prepared.options, out=out)), quiet=True)
    except AcrcError as error:
        return str(error)


def _result_findings(result: RunResult) -> Iterator[str]:
    """Yield faults visible in the result of an undisturbed run."""
    yield from result.refused_reports
    if result.places_lost:
        yield f"{result.places_lost} places are in no robot's route and were neither reported nor given up"
    for name in _DROPPED:
        if count := result.frames.get(name, 0):
            yield f"{name} is {count}: more frames sent than the radio accepts; publish less or less often"


def check_task(make: Callable[[], Task], robots: Sequence[str] = ("r1", "r2")) -> list[str]:
    """Check a task and return findings as sentences; `make` must return a new task at each call.

    Checked: its methods and their types; equal progress and outcome for equal inputs; an outcome that can be
    written as JSON; wrong reports refused with a message instead of an exception.
    """
    try:
        first, second = _exercise(make(), robots), _exercise(make(), robots)
    except Exception as error:  # any exception of user code is a finding
        return [f"{type(error).__name__}: {error}"]
    findings = [*first.findings]
    if first.states != second.states:
        step = next(
            step
            for step, (one, two) in enumerate(zip(first.states, second.states, strict=True))
            if one != two
        )
        findings.append(
            f"two tasks with equal inputs differ in step {step}: a task must depend on its inputs only"
        )
    return findings


class _TaskTrace(NamedTuple):
    """States of a task over some steps, and faults of its answers."""

    states: list[str]
    findings: list[str]


def _exercise(task: Task, robots: Sequence[str]) -> _TaskTrace:
    """Feed positions, reports, a restart and a new place to a task; return its states."""
    generator = np.random.default_rng(1)
    states, findings = list[str](), set[str]()
    for step in range(_STEPS):
        instant = Instant(step * milliseconds(100))
        task.watch(instant, generator.uniform(0, 10, (len(robots), 2)))
        for robot in robots:
            claim = Drive(step, 0.0, 0.0, 0.0, 0, reports=(VisitReport(robot, step, instant),))
            answers = [
                task.take(robot, Drive(step, 0.0, 0.0, 0.0, 0)),
                task.take(robot, claim),
            ]
            findings.update(
                f"take() returned {answer!r}; must be None or a sentence"
                for answer in answers
                if answer is not None and not isinstance(answer, str)
            )
        if step == _STEPS // 2:
            task.restart(robots[0])
            task.give(instant, robots[0], [(1.0, 1.0)])
        if not isinstance(task.settled, bool):
            findings.add(f"settled is {task.settled!r}; must be True or False")
        states.append(repr((task.settled, task.progress(robots))))
    try:
        states.append(msgspec.json.encode(task.outcome(robots)).decode())
    except TypeError as error:
        findings.add(f"outcome() cannot be written as JSON: {error}")
    return _TaskTrace(states, sorted(findings))
