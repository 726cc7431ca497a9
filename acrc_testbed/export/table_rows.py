"""Rows of the exported tables."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.frame_outcomes import FrameRow, frame_rows
from acrc_testbed.run_model.recording_readers import frame_outcomes, messages_on
from acrc_testbed.run_model.robot_introspection import RobotInternals
from acrc_testbed.run_model.simulated_runs import read_run
from actors.messages import TRUTH

Row = tuple[Any, ...]
"""Cells of a row."""
Tables = dict[str, list[Row]]
INTERNALS: Final = ("estimates", "goals", "knowledge", "exchanges", "decisions")
"""Tables of the robots' introspection."""


def tables(out: Path) -> Tables:
    """Return the tables of a simulated run by name; a lean recording lacks some.

    Raises RecordingError or RunDataError for an incomplete or damaged folder.
    """
    run, files = read_run(out, internals=True), all_recordings(out)
    found: Tables = {
        "poses": list(_poses(files["radio"])),
        "people": list(_people(run)),
        "places": list(_places(run)),
        "outcomes": list(_outcomes(run)),
    }
    if run.description.records_frames:
        copies = enumerate(frame_rows(*frame_outcomes(out)))
        found["frames"] = [row for number, one in copies for row in _frame(number, one)]
    if not all(one.is_recorded for one in run.internals):
        return found
    found |= {name: [] for name in INTERNALS}
    for one in run.internals:
        head = (one.process.robot, one.process.actor)
        for name, rows in _robot_rows(run, one).items():
            found[name] += [(*row[:2], *head, *row[2:]) for row in rows]
    return found | {name: sorted(found[name], key=lambda row: int(row[0])) for name in INTERNALS}


def _robot_rows(run: RunData, one: RobotInternals) -> Tables:
    """Return the rows of one robot process by table."""
    return {
        "estimates": list(_estimates(run, one)),
        "goals": list(_goals(run, one)),
        "knowledge": list(_knowledge(one)),
        "exchanges": list(_exchanges(run, one)),
        "decisions": list(_decisions(one)),
    }


def _step_cells(run: RunData, step: int) -> Row:
    """Return the first cells of a row at the start of a step."""
    return (step, step * run.step_us / 1e6)


def _estimates(run: RunData, robot: RobotInternals) -> Iterator[Row]:
    index, true = run.robots.index(robot.process.robot), run.true
    for step, pose, quality in robot.step_estimates:
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


def _places(run: RunData) -> Iterator[Row]:
    judged = run.result is not None
    for one in run.outcomes:
        yield (
            one.owner, one.place, one.x, one.y, one.given_at / 1e6, one.verdict.value if judged else None,
            _seconds(one.reached_at), one.reached_by, _seconds(one.reported_at), one.reported_by,
            _seconds(one.given_up_at), one.given_up_by, one.reason,
        )  # fmt: skip


def _outcomes(run: RunData) -> Iterator[Row]:
    outcome = {} if run.result is None else run.result.outcome
    for name, by_robot in outcome.items():
        for robot, value in by_robot.items():
            yield (robot, name, None, value) if isinstance(value, str) else (robot, name, float(value), None)


def _seconds(instant: int | None) -> float | None:
    return None if instant is None else instant / 1e6
