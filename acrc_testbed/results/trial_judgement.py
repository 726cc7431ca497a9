"""Judgement of a field trial: the task's judge run over the robots' recorded reports."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import FieldTrial, FieldTrialError, Moment, RobotLog
from actors.array_types import Floats
from actors.instant import Instant, seconds
from actors.items import ItemGivenUp, ItemKey, TaskLimits, task_reports_fault
from actors.messages import Drive, TaskChanged
from actors.settings import decode
from actors.task.checked_judge import CheckedJudge
from actors.task.loading import ReportError, decode_items, decode_reports, load_task, task_setup
from actors.task.task import Judge, JudgeSetup, Task, TaskDeclaration, TaskError, TaskOutcome

if TYPE_CHECKING:
    from firmware_bridge.laboratory.laboratory import LaboratoryResult

_SWITCH_OFF: Final = seconds(30)
"""Robots that stopped at most so long before the last one count as running at the end, because they are
switched off one by one."""


class TrialVerdict(NamedTuple):
    """Outcome of a field trial's task, and its course."""

    declaration: TaskDeclaration
    outcome: TaskOutcome
    changes: tuple[tuple[int, TaskChanged], ...]
    """Marks and events, each with its instant, µs since the start of the trial."""
    notes: tuple[str, ...]
    """Sentences on unknown data."""


class _AnswerPart(NamedTuple):
    """One report of a robot, or its route: a part of its answer to a step."""

    reports: tuple[Any, ...] = ()
    given_up: tuple[ItemGivenUp, ...] = ()
    route: tuple[ItemKey, ...] | None = None


class _TimedPart(NamedTuple):
    """Part of an answer to the step from `begin` to `end`; instants since the start of the trial, µs."""

    instant: int
    robot: str
    part: _AnswerPart | None
    """None: the robot has been restarted."""
    begin: int = 0
    end: int = 0


def judge_reports(
    trial: FieldTrial, clocks: AlignedClocks, truth: "LaboratoryResult | None" = None
) -> TrialVerdict:
    """Run the judge of the trial's task over the robots' reports, and over true positions if they are known.

    Raises AcrcError for a task that is neither installed nor permitted, and FieldTrialError for the ground
    truth of another field trial.
    """
    task, setup = load_task(trial.task.use), task_setup(trial.task.use, trial.task.settings)
    items = {
        robot: decode_items(task, logs[0].identity.items, f"{logs[0].path}: items")
        for robot, logs in trial.logs.items()
    }
    judge = CheckedJudge(
        task,
        JudgeSetup(
            robots=tuple(items),
            items=items,
            settings=decode(task.settings, setup.settings, setup.declaration.table),
            duration_us=clocks.span,
            has_truth=truth is not None,
        ),
    )
    faults: list[str] = []
    parts = sorted(_parts(trial, clocks, task, faults), key=attrgetter("instant"))
    positions = deque(() if truth is None else _true_positions(truth, clocks, tuple(items)))
    changes: list[tuple[int, TaskChanged]] = []
    for part in (*parts, None):
        now = clocks.span if part is None else part.instant
        while positions and positions[0][0] <= now:
            judge.watch(*positions.popleft())
        if part is not None and (fault := _take(judge, part, items)):
            faults.append(f"{part.robot} {fault}")
        if part is None:  # its outcome may show final marks
            outcome = judge.outcome(_running_at_end(trial, clocks), Instant(clocks.span))
        if any(changed := judge.take_changes()):
            changes.append((now, TaskChanged(0, *changed)))
    notes = [f"{len(faults)} reports are left out; the first: {faults[0]}"] if faults else []
    if truth is not None and truth.lost_ms:
        notes.append(f"the emulation fell behind, so the true instants are early by up to {truth.lost_ms} ms")
    return TrialVerdict(setup.declaration, outcome, tuple(changes), tuple(notes))


def judge_if_loadable(trial: FieldTrial, clocks: AlignedClocks) -> TrialVerdict:
    """Return the judgement; if the task cannot be loaded, its recorded declaration and a note."""
    try:
        return judge_reports(trial, clocks)
    except TaskError as error:
        if trial.task.declaration is None:
            raise
        return TrialVerdict(trial.task.declaration, TaskOutcome("", {}, {}), (), (str(error),))


def _parts(trial: FieldTrial, clocks: AlignedClocks, task: Task, faults: list[str]) -> Iterator[_TimedPart]:
    """Yield the parts of all answers, of each robot in order; append the faults of invalid ones."""
    for robot, logs in trial.logs.items():
        for number, log in enumerate(log for log in logs if log.ticks):
            if number:
                start = clocks.instant(log, Moment(0, log.ticks[0].instant)) - clocks.begin
                yield _TimedPart(start, robot, None)
            for tick, drive in log.messages_of(Drive):
                yield from _answer_parts(log, tick, drive, clocks, task, faults)


def _answer_parts(
    log: RobotLog, tick: int, drive: Drive, clocks: AlignedClocks, task: Task, faults: list[str]
) -> Iterator[_TimedPart]:
    begin, robot = log.ticks[tick].instant, log.identity.id
    end = max((begin + log.identity.step_us, *(one.instant for one in log.ticks[tick + 1 : tick + 2])))

    def since_start(instant: int) -> int:
        return clocks.instant(log, Moment(tick, instant)) - clocks.begin

    def with_instant(report: Any) -> Any:
        own = getattr(report, "instant", None)
        return msgspec.structs.replace(report, instant=since_start(own)) if type(own) is int else report

    latest, span = since_start(begin), (since_start(begin), since_start(end) + 1)
    for part in _split(drive):
        try:
            if fault := task_reports_fault(part, begin, end, TaskLimits()):
                raise ReportError(fault)
            reports = tuple(map(with_instant, decode_reports(task, part, begin, end).reports))
        except ReportError as error:
            faults.append(f"{robot} {error}")
            continue
        given_up = tuple(map(with_instant, part.given_up))
        instant = next((getattr(one, "instant", latest) for one in (*reports, *given_up)), latest)
        latest = max(latest, instant)
        yield _TimedPart(instant, robot, _AnswerPart(reports, given_up, part.route), *span)


def _split(drive: Drive) -> Iterator[_AnswerPart]:
    """Yield the parts of an answer, of which one may be invalid."""
    yield from (_AnswerPart(reports=(report,)) for report in drive.reports)
    yield from (_AnswerPart(given_up=(one,)) for one in drive.given_up)
    if drive.route is not None:
        yield _AnswerPart(route=drive.route)


def _take(judge: Judge, one: _TimedPart, items: Mapping[str, Sequence[Any]]) -> str | None:
    """Pass a part to the judge; return its fault, None if valid."""
    if one.part is None:
        judge.restart(one.robot)
        return None
    fault = judge.take(one.robot, one.part, one.begin, one.end)
    if fault is None or one.part.route is None:
        return fault
    known = tuple(key for key in one.part.route if 0 <= key.number < len(items.get(key.owner, ())))
    return judge.take(one.robot, _AnswerPart(route=known), one.begin, one.end)


def _running_at_end(trial: FieldTrial, clocks: AlignedClocks) -> tuple[str, ...]:
    """Return the robots that were running at the end."""
    ends = {
        robot: clocks.instant(log, Moment(len(log.ticks) - 1, log.ticks[-1].instant))
        for robot, logs in trial.logs.items()
        for log in logs
        if log.ticks
    }
    latest = max(ends.values())
    return tuple(robot for robot, end in ends.items() if latest - end <= _SWITCH_OFF)


def _true_positions(
    truth: "LaboratoryResult", clocks: AlignedClocks, robots: Sequence[str]
) -> Iterator[tuple[Instant, Floats]]:
    """Yield instants since the start of the trial, and the true positions of its robots, (n, 2) m.

    Devices are emulated on the robots' machine, so they share the reference robot's clock. Raises
    FieldTrialError if the emulation is not of this field trial.
    """
    ahead = truth.began_us - clocks.begin
    if not -(truth.simulated_s * 1e6 + truth.lost_ms * 1e3) <= ahead <= clocks.span:
        raise FieldTrialError(
            f"--truth: the emulation began {ahead / 1e6:.0f} s after the field trial and lasted "
            f"{truth.simulated_s:.0f} s; give the result of the same field trial"
        )
    if missing := [robot for robot in robots if robot not in truth.robots]:
        raise FieldTrialError(f"--truth: there is no {missing[0]}; give the result of the same field trial")
    columns = [[*truth.robots].index(robot) for robot in robots]
    size = 8 * len(truth.robots)
    known = np.frombuffer(truth.positions, "<f4", 2 * len(truth.robots) * (len(truth.positions) // size))
    samples = known.reshape(-1, len(truth.robots), 2)[:, columns].astype(np.float64)
    for number, positions in enumerate(samples):
        instant = ahead + number * truth.sample_us
        if instant > -truth.sample_us:
            yield Instant(max(0, instant)), positions
