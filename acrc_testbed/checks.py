"""API tests of user code: `check_strategy` and `check_task` return findings."""

import inspect
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final, get_args

import msgspec
import numpy as np
from msgspec.structs import replace

from acrc_testbed.recordings.record_replay import RecheckError, recheck
from acrc_testbed.results.result import RunResult
from acrc_testbed.shipped import file_of
from actors.installation.repository import SHIPPED
from actors.instant import Instant, milliseconds
from actors.messages import Drive
from actors.robot.behaviour.code_permit import permit_of
from actors.robot.behaviour.loading import entry_function
from actors.runtime.errors import AcrcError
from actors.task.loading import decode_items, load_task
from actors.task.task import Task
from actors.user_code import set_folders
from actors.wording import toml_text
from actors.world.program import build
from actors.world.world_setup import WorldSetup
from cleaning.strategies import entry
from deploy.run.options import RunOptions
from deploy.run.start import PreparedRun, prepare_run, start_run
from deploy.run.swarm_replay import divergence
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.tables import EventTable

_EVENTS: Final = (
    EventTable(at=2.0, freeze="r1"),
    EventTable(at=3.0, thaw="r1"),
    EventTable(at=4.0, restart="r2"),
    EventTable(at=5.0, lose="r1", of="r2"),
)
"""Disturbances that a strategy must handle: missed steps, a restart with empty state, a lost frame."""
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
    elif lost := third.task.get("places_lost"):
        yield (
            f"after a restart {lost} places are in no robot's route; "
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
    if lost := result.task.get("places_lost"):
        yield f"{lost} places are in no robot's route and were neither reported nor given up"
    for name in ("frames_dropped", "frames_overflow"):
        if count := result.frames.get(name, 0):
            yield f"{name} is {count}: more frames sent than the radio accepts; publish less or less often"


def check_task(
    task: str | type[Task],
    *,
    scenario: str | PathLike[str] | None = None,
    settings: Mapping[str, object] | None = None,
    reports: Sequence[object] = (),
    modules: Sequence[str | PathLike[str]] = (),
) -> list[str]:
    """Check a task, given as for `[task] use` or as its class, and return findings as sentences.

    Two judges get equal inputs for 5 s without a run: positions, reports, items, a restart. Checked: the
    declaration, drawn items, types of all answers, columns of metrics, states of marks and kinds of events,
    wrong reports, and equal answers of both judges (no clock, chance or shared state).

    `scenario`: default: two robots on the corridor map; `settings`: values of the task's table; `reports`:
    sent beside made-up ones; `modules`: folders with its code.
    """
    folders = [Path(folder) for folder in modules]
    if not isinstance(task, str):
        folders.append(Path(inspect.getfile(task)).resolve().parents[task.__module__.count(".")])
        task = f"{task.__module__}:{task.__qualname__}"
    permit_of(folders)
    try:
        table = load_task(task).declaration.table
        values = tuple((f"{table}.{name}", value) for name, value in (settings or {}).items())
        overrides = Overrides(settings=values)
        text = f"map = 'corridor.yaml'\nrobots.count = 2\nrun.strategy = 'none'\ntask.use = {toml_text(task)}"
        read = (
            parse(text, SHIPPED / "maps" / "check.toml", overrides)
            if scenario is None
            else load_scenario(file_of("scenarios", scenario), overrides)
        )
        world = resolve(read).world
        first, second = (_judge_answers(world, reports) for _ in range(2))
    except AcrcError as error:
        return [str(error)]
    for step, (one, two) in enumerate(zip(first, second, strict=True)):
        if one != two:
            return [f"two judges with equal inputs differ in step {step}: one answers {one}, the other {two}"]
    return []


def _judge_answers(world: WorldSetup, reports: Sequence[object]) -> list[str]:
    """Return the answers of the world's judge in each step, as text. Raises AcrcError for the first fault."""
    task, judge, robots = load_task(world.task.use), build(world).judge, [one.id for one in world.robots]
    positions, found = np.random.default_rng(1), list[str]()
    wrong = (*_reports(task, robots[0], 0), *_reports(task, "unknown", 10**6))
    sent = [(), *((one,) for one in (*reports, *wrong))]
    for step in range(_STEPS):
        begin = Instant(step * milliseconds(100))
        judge.watch(begin, positions.uniform(0, 10, (len(robots), 2)))
        drives = [Drive(step, 0.0, 0.0, 0.0, 0, reports=one) for one in sent]
        end = begin + milliseconds(100)
        answers = [judge.take(robot, drive, begin, end) for robot in robots for drive in drives]
        if step == _STEPS // 2:
            judge.restart(robots[0])
            answers.append(judge.give(begin, robots[0], decode_items(task, world.robots[0].items)))
        found.append(repr((answers, judge.settled, judge.progress(robots), judge.take_changes())))
    found.append(repr((judge.outcome(robots, Instant(world.duration_us)), judge.take_changes())))
    return found


def _reports(task: Task, text: str, number: int) -> Iterator[object]:
    """Yield a report of each type of the task, with these values in fields without a default."""
    for kind in get_args(task.report) or filter(None, (task.report,)):
        required = [field for field in msgspec.structs.fields(kind) if field.required]
        values: tuple[object, ...] = (text, number, float(number), True, None, (), {})
        fitting = {
            one.name: [value for value in (*get_args(one.type), *values) if _is_of(value, one.type)]
            for one in required
        }
        if all(fitting.values()):
            yield kind(**{name: choices[0] for name, choices in fitting.items()})


def _is_of(value: object, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True
