"""Rows of the exported tables, from recordings and from traces of radio and robots."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from acrc_testbed.replay.run_recordings import all_recordings, run_of, setup_of
from acrc_testbed.replay.sandboxed import Bounds
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.frames import FrameRow, frame_rows
from acrc_testbed.run_model.recorded import frame_outcomes, messages_on
from acrc_testbed.run_model.simulated import read_run
from acrc_testbed.trace.rows import KnowledgeChange, Trace
from acrc_testbed.trace.traces import BOUNDS, TraceError, traces
from actors.instant import in_seconds
from actors.messages import TRUTH
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError, printable

Row = tuple[Any, ...]
"""Its cells."""
Tables = dict[str, list[Row]]
TRACED: Final = ("estimates", "goals", "knowledge", "exchanges", "decisions")
"""The tables that come of it."""


def robot_rows(trace: Trace, step_us: int) -> Tables:
    """Its rows by table."""
    return {
        "estimates": list(_estimates(trace, step_us)),
        "goals": list(_goals(trace, step_us)),
        "knowledge": list(_knowledge(trace)),
        "exchanges": list(_exchanges(trace)),
        "decisions": list(_decisions(trace)),
    }


def _begun(step: int, step_us: int) -> Row:
    """The first cells of what is so from a step's beginning."""
    return (step, step * step_us / 1e6)


def _estimates(trace: Trace, step_us: int) -> Iterator[Row]:
    held = trace.held
    columns = (held.steps, held.poses, held.located, held.variances, held.lost)
    for step, pose, located, variances, lost in zip(*(one.tolist() for one in columns), strict=True):
        yield (*_begun(step, step_us), *pose, located, *variances, lost, None)


def _goals(trace: Trace, step_us: int) -> Iterator[Row]:
    for one in trace.goals:
        yield (*_begun(one.step, step_us), *(one.point or (None, None)), one.status, one.reason, one.phase)


def _head(change: KnowledgeChange) -> Row:
    return (change.step, change.instant / 1e6)


def _knowledge(trace: Trace) -> Iterator[Row]:
    for number, one in enumerate(trace.changes):
        head = (*_head(one), one.component, number, one.by, one.adaptation)
        for part in one.changed:
            yield (*head, part.path, part.before, part.after)


def _exchanges(trace: Trace) -> Iterator[Row]:
    for number, one in enumerate(trace.changes):
        if not one.peer:
            continue
        head = (*_head(one), one.component, number, one.by, one.peer)
        read = one.read
        if read is None:
            yield (*head, None, None, None, None, None, None, None)
        else:
            via = None if read.arrival is None else read.arrival.sender
            when = (in_seconds(read.heard), in_seconds(read.age))
            yield (*head, read.epoch, read.publication, *when, read.hops, read.rssi_dbm, via)


def _decisions(trace: Trace) -> Iterator[Row]:
    """As the robot's last record has them, but of runs that were cut off, too."""
    for number, one in enumerate(trace.changes):
        if (decision := one.decision) is not None:
            head = (*_head(one), number, one.by, decision.words, one.peer or one.component)
            yield (*head, *(decision.old or (None, None)), *(decision.new or (None, None)))


class ExportError(AcrcError):
    """A robot whose rows are not to be had."""


def tables(
    out: Path,
    on_actor: Callable[[str], object] = lambda actor: None,
    *,
    permit: Permit,
    isolate: bool,
    bounds: Bounds = BOUNDS,
) -> Tables:
    """Every table of a simulated run, by its name; `on_actor` is told whose trace is needed.

    `isolate`: see `actors.runtime.isolation.sandbox`. Raises RecordingError and RunDataError for what is
    no whole folder of a run, ExportError for a robot without a trace, or with one that makes no sense.
    """
    run, files = read_run(out), all_recordings(out)
    found: Tables = {"poses": list(_poses(files["radio"])), "places": list(_places(run))}
    frames = frame_rows(*frame_outcomes(out))
    found["frames"] = [row for number, one in enumerate(frames) for row in _frame(number, one)]
    found |= {name: [] for name in TRACED}
    told = setup_of(files["radio"], RadioSetup, "a radio")
    addresses = {number: name for name, number in told.robots}
    robots = {actor: path.parent.name for actor, path in files.items() if actor not in ("world", "radio")}
    on_actor("robots")
    traced: dict[str, Tables] = {}
    for one in traces(out, list(robots), permit=permit, isolate=isolate, bounds=bounds):
        try:
            traced[one.actor] = robot_rows(one.whole(), run_of(files[one.actor]).step_us)
        except TraceError as error:
            raise ExportError(printable(str(error))) from None
        on_actor(f"robots ({len(traced)} of {len(robots)} are done)")
    for actor, robot in robots.items():
        for name, rows in _completed(run, addresses, robot, traced[actor]).items():
            found[name] += [(*row[:2], robot, actor, *row[2:]) for row in rows]
    return found | {name: sorted(found[name], key=lambda row: int(row[0])) for name in TRACED}


def _completed(run: RunData, addresses: dict[int, str], robot: str, rows: Tables) -> Tables:
    """With what its process does not know."""
    if robot not in run.robots:
        raise ExportError(f"{robot}: is no robot of this run")
    index, true = run.robots.index(robot), run.true
    estimates = []
    for step, second, x, y, *rest, _ in rows["estimates"]:
        if 0 <= step < len(true):
            there = true[step, index].tolist()
            error = ((x - there[0]) ** 2 + (y - there[1]) ** 2) ** 0.5
            estimates.append((step, second, x, y, *rest, error))
    exchanges = [(*row[:-1], addresses.get(row[-1])) for row in rows["exchanges"]]
    return rows | {"estimates": estimates, "exchanges": exchanges}


def _poses(radio: Path) -> Iterator[Row]:
    for _, truth in messages_on(radio, TRUTH):
        if not truth.halt:
            for one in truth.robots:
                where = (one.x, one.y, one.heading, one.vx, one.vy, one.omega)
                yield (truth.step, truth.instant / 1e6, one.id, *where, one.stepping, one.powered)


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
            _second(one.reached_at), one.reached_by, _second(one.reported_at), one.reported_by,
            _second(one.given_up_at), one.given_up_by, one.reason,
        )  # fmt: skip


def _second(instant: int | None) -> float | None:
    return None if instant is None else instant / 1e6
