"""Rows of the exported tables."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.frame_outcomes import FrameRow, frame_rows
from acrc_testbed.run_model.recording_readers import frame_outcomes, messages_on
from acrc_testbed.run_model.robot_introspection import RobotInternals
from acrc_testbed.run_model.simulated_runs import read_run
from actors.messages import TRUTH
from actors.task.task import TaskDeclaration

Row = tuple[Any, ...]
"""Cells of a row."""
Tables = dict[str, list[Row]]
INTERNALS: Final = ("estimates", "goals", "knowledge", "exchanges", "decisions")
"""Tables of the robots' introspection."""
_OTHERS: Final = frozenset({"poses", "people", "outcomes", "frames", *INTERNALS})


class RunTables(NamedTuple):
    """Rows of all tables of a run."""

    task: TaskDeclaration
    rows: Tables
    """By name of the table; a lean recording lacks some."""


def tables(out: Path) -> RunTables:
    """Return the tables of a simulated run.

    Raises RecordingError or RunDataError for an incomplete or damaged folder.
    """
    run, files = read_run(out, internals=True), all_recordings(out)
    task = run.description.task
    found: Tables = {
        "poses": list(_poses(files["radio"])),
        "people": list(_people(run)),
        items_name(task): list(_items(run)),
        "outcomes": list(_outcomes(run)),
    }
    if run.description.records_frames:
        copies = enumerate(frame_rows(*frame_outcomes(out)))
        found["frames"] = [row for number, one in copies for row in _frame(number, one)]
    if not all(one.is_recorded for one in run.internals):
        return RunTables(task, found)
    found |= {name: [] for name in INTERNALS}
    for one in run.internals:
        head = (one.process.robot, one.process.actor)
        tables = (
            _estimates(run, one),
            _goals(run, one),
            _knowledge(one),
            _exchanges(run, one),
            _decisions(one),
        )
        for name, rows in zip(INTERNALS, tables, strict=True):
            found[name] += [(*row[:2], *head, *row[2:]) for row in rows]
    found |= {name: sorted(found[name], key=lambda row: int(row[0])) for name in INTERNALS}
    return RunTables(task, found)


def _step_cells(run: RunData, step: int) -> Row:
    """Return the first cells of a row at the start of a step."""
    return (step, step * run.step_us / 1e6)


def _estimates(run: RunData, robot: RobotInternals) -> Iterator[Row]:
    index, true = run.robots.index(robot.process.robot), run.true
    for step, _, pose, quality in robot.step_estimates:
        error = None
        if 0 <= step < len(true):
            there = true[step, index].tolist()
            error = ((pose[0] - there[0]) ** 2 + (pose[1] - there[1]) ** 2) ** 0.5
        variances = (quality.covariance[number] for number in (0, 4, 8))
        yield (*_step_cells(run, step), *pose, quality.located, *variances, quality.lost, error)


def _goals(run: RunData, robot: RobotInternals) -> Iterator[Row]:
    for step, goal in robot.goals:
        yield (*_step_cells(run, step), *(goal.point or (None, None)), goal.status, goal.reason, goal.phase)


def _knowledge(robot: RobotInternals) -> Iterator[Row]:
    for one in robot.commits:
        commit = one.commit
        head = (one.step, one.second, commit.component, one.number, commit.by, commit.adaptation)
        for part in commit.changed:
            yield (*head, part.path, part.before, part.after)


def _exchanges(run: RunData, robot: RobotInternals) -> Iterator[Row]:
    for one in robot.commits:
        commit, used = one.commit, one.commit.replica
        if not commit.peer:
            continue
        head = (one.step, one.second, commit.component, one.number, commit.by, commit.peer)
        if used is None:
            yield (*head, None, None, None, None, None, None, None)
        else:
            via = None if one.via is None else run.description.addresses.get(one.via)
            when = (used.heard / 1e6, (commit.instant - used.heard) / 1e6)
            yield (*head, used.epoch, used.publication, *when, used.hops, used.rssi_dbm, via)


def _decisions(robot: RobotInternals) -> Iterator[Row]:
    """Yield the decisions, also of runs that were cut off."""
    for one, decision in robot.decisions():
        source = one.commit.peer or one.commit.component
        head = (one.step, one.second, one.number, one.commit.by, decision.words, source)
        yield (*head, *(decision.old or (None, None)), *(decision.new or (None, None)))


def _poses(radio: Path) -> Iterator[Row]:
    for _, truth in messages_on(radio, TRUTH):
        if not truth.halt:
            charges = truth.charges or (None,) * len(truth.robots)
            for one, charge in zip(truth.robots, charges, strict=True):
                where = (one.x, one.y, one.heading, one.vx, one.vy, one.omega)
                yield (truth.step, truth.instant / 1e6, one.id, *where, one.stepping, one.powered, charge)


def _people(run: RunData) -> Iterator[Row]:
    for step, people in enumerate(run.people.tolist()):
        for number, person in enumerate(people, start=1):
            yield (*_step_cells(run, step), number, *person)


def _frame(number: int, one: FrameRow) -> Iterator[Row]:
    head = (number, one.robot, one.tag, one.handed / 1e6, one.ended / 1e6, one.size, one.end)
    if not one.copies:
        yield (*head, None, None, None)
    for copy in one.copies:
        yield (*head, copy.robot, copy.outcome, copy.strength_dbm)


def items_name(task: TaskDeclaration) -> str:
    """Return the name of the table of items; "items" if the declared one is unusable as a file's name."""
    name = task.table
    return "items" if name in _OTHERS or not re.fullmatch("[a-z][a-z0-9_]{0,39}", name) else name


def _items(run: RunData) -> Iterator[Row]:
    columns = [column.name for column in run.description.task.columns]
    for one in run.items:
        yield tuple(map(one.get, columns))


def _outcomes(run: RunData) -> Iterator[Row]:
    outcome = {} if run.result is None else run.result.outcome
    for name, by_robot in outcome.items():
        for robot, value in by_robot.items():
            yield (robot, name, None, value) if isinstance(value, str) else (robot, name, float(value), None)
