"""Judgement of a field trial: the task's judge run over the robots' recorded reports."""

from collections.abc import Iterator
from operator import attrgetter
from typing import Any, Final, NamedTuple

import msgspec

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import FieldTrial, Moment, RobotLog
from actors.instant import Duration, Instant, seconds
from actors.items import ItemGivenUp, ItemKey
from actors.messages import Drive, TaskChanged
from actors.settings import decode
from actors.task.loading import DEFAULT, decode_items, decode_reports, load_task, task_setup
from actors.task.task import JudgeSetup, TaskDeclaration, TaskError, TaskOutcome

_SWITCH_OFF: Final[Duration] = seconds(30)
"""Robots that stopped at most so long before the last one count as running at the end, because they are
switched off one by one."""


class TrialJudgement(NamedTuple):
    """Outcome of a field trial's task, and its course."""

    declaration: TaskDeclaration
    outcome: TaskOutcome
    changes: tuple[tuple[int, TaskChanged], ...]
    """Marks and events, each with its instant, µs since the start of the trial."""
    notes: tuple[str, ...]
    """Sentences on unknown data."""


class _Answer(NamedTuple):
    """Part of a robot's reports of a step, with instants by the clock of the trial."""

    reports: tuple[Any, ...] = ()
    given_up: tuple[ItemGivenUp, ...] = ()
    route: tuple[ItemKey, ...] | None = None


class _Step(NamedTuple):
    begin: int
    """µs since the start of the trial."""
    robot: str
    log: RobotLog
    tick: int
    drive: Drive | None
    """None: a restarted process begins."""


def judge_reports(trial: FieldTrial, clocks: AlignedClocks, name: str = DEFAULT) -> TrialJudgement:
    """Run the judge of a task over the reports of all robots. Raises TaskError."""
    task = load_task(name)
    declaration = task_setup(name, {}).declaration
    judge = task.judge(
        JudgeSetup(
            robots=tuple(trial.logs),
            items={robot: decode_items(task, logs[0].identity.items) for robot, logs in trial.logs.items()},
            settings=decode(task.settings, {}, declaration.table),
            duration_us=clocks.span,
        )
    )
    changes, invalid = [(0, TaskChanged(0, *judge.take_changes()))], 0
    for step in sorted(_steps(trial, clocks), key=attrgetter("begin")):
        if step.drive is None:
            judge.restart(step.robot)
            continue
        try:
            reports = decode_reports(task, step.drive).reports
        except TaskError:
            reports, invalid = (), invalid + 1
        end = step.begin + step.log.identity.step_us
        for part in _parts(step, reports, clocks, end):
            invalid += judge.take(step.robot, part, step.begin, end) is not None
        if any(changed := judge.take_changes()):
            changes.append((step.begin, TaskChanged(step.drive.step, *changed)))
    outcome = judge.outcome(_present(trial, clocks), Instant(clocks.span))
    changes.append((clocks.span, TaskChanged(0, *judge.take_changes())))
    notes = (f"{invalid} reports were about {declaration.items} that do not exist, and are left out",)
    return TrialJudgement(declaration, outcome, tuple(changes), notes if invalid else ())


def _steps(trial: FieldTrial, clocks: AlignedClocks) -> Iterator[_Step]:
    """Yield the robots' answers with reports, and their restarts."""
    for robot, logs in trial.logs.items():
        for number, log in enumerate(logs):
            begins = [
                clocks.instant(log, Moment(index, tick.instant)) - clocks.begin
                for index, tick in enumerate(log.ticks)
            ]
            if number and begins:
                yield _Step(begins[0], robot, log, 0, None)
            for tick, drive in log.messages_of(Drive):
                if drive.reports or drive.given_up or drive.route is not None:
                    yield _Step(begins[tick], robot, log, tick, drive)


def _parts(step: _Step, reports: tuple[Any, ...], clocks: AlignedClocks, end: int) -> Iterator[_Answer]:
    """Yield each report, each item given up and the route by itself, so that a faulty one hides no other."""

    def shifted(report: Any) -> Any:
        if not isinstance(instant := getattr(report, "instant", None), int):
            return report
        at = clocks.instant(step.log, Moment(step.tick, instant)) - clocks.begin
        return msgspec.structs.replace(report, instant=min(max(at, step.begin), end - 1))

    drive = step.drive
    assert drive is not None
    yield from (_Answer(reports=(shifted(one),)) for one in reports)
    yield from (_Answer(given_up=(shifted(one),)) for one in drive.given_up)
    if drive.route is not None:
        yield _Answer(route=drive.route)


def _present(trial: FieldTrial, clocks: AlignedClocks) -> tuple[str, ...]:
    """Return the robots that were running at the end."""
    ends = {
        robot: max(
            clocks.instant(log, Moment(len(log.ticks) - 1, log.ticks[-1].instant))
            for log in logs
            if log.ticks
        )
        for robot, logs in trial.logs.items()
        if any(log.ticks for log in logs)
    }
    latest = max(ends.values())
    return tuple(robot for robot, end in ends.items() if latest - end <= _SWITCH_OFF)
