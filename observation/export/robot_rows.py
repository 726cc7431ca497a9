"""The rows of one process of a robot, from executing it again: its strategy runs in this process.

Cells stand in the order of a table's columns, without `robot` and `process`; what only others know is added
by whoever asked (`rows`): of an estimate its error, of an exchange the robot behind the address in `via`.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from actors.instant import in_seconds
from actors.robot.behaviour.decision_log import Deciding
from deeco.knowledge import Knowledge
from observation.evidence.drive_trace import DriveTrace
from observation.evidence.knowledge_trace import ABSENT, KnowledgeChange, KnowledgeTrace, trace_knowledge
from observation.replay.recorded_setup import run_of
from observation.replay.run_recordings import recordings

Row = tuple[Any, ...]
"""Its cells."""
Tables = dict[str, list[Row]]
EXECUTED: Final = ("estimates", "goals", "knowledge", "exchanges", "decisions")
"""The tables that come of it."""


def robot_rows(out: Path, actor: str) -> Tables:
    """Execute a robot's process again; its rows by table.

    Raises ReplayError if it does not do again what it did, RecordingError for a damaged recording.
    """
    step_us, drive = run_of(recordings(out)[actor]).step_us, DriveTrace()
    trace = trace_knowledge(out, actor, prepare=drive.prepare)
    return {
        "estimates": list(_estimates(drive, step_us)),
        "goals": list(_goals(drive, step_us)),
        "knowledge": list(_knowledge(trace.changes)),
        "exchanges": list(_exchanges(trace.changes)),
        "decisions": list(_decisions(trace)),
    }


def _begun(step: int, step_us: int) -> Row:
    """The first cells of what is so from a step's beginning."""
    return (step, step * step_us / 1e6)


def _estimates(drive: DriveTrace, step_us: int) -> Iterator[Row]:
    for step, estimate in drive.held:
        spread = estimate.covariance
        variances = (float(spread[0]), float(spread[4]), float(spread[8]))
        pose = map(float, estimate.pose)
        yield (*_begun(step, step_us), *pose, bool(estimate.located), *variances, float(estimate.lost), None)


def _goals(drive: DriveTrace, step_us: int) -> Iterator[Row]:
    for step, goal in drive.goals:
        if goal is None:
            yield (*_begun(step, step_us), None, None, None, None, None)
        else:
            words = (one and one.value for one in (goal.status, goal.reason, goal.phase))
            yield (*_begun(step, step_us), goal.point.x, goal.point.y, *words)


def _head(change: KnowledgeChange) -> Row:
    return (change.step, change.instant / 1e6)


def _knowledge(changes: Iterable[KnowledgeChange]) -> Iterator[Row]:
    for number, one in enumerate(changes):
        head = (*_head(one), one.component, number, one.by, one.adaptation)
        for path, before, after in one.changed:
            yield (*head, path, _json(before), _json(after))


def _exchanges(changes: Iterable[KnowledgeChange]) -> Iterator[Row]:
    for number, one in enumerate(changes):
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


def _decisions(trace: KnowledgeTrace) -> Iterator[Row]:
    """As `actors.robot.behaviour.decision_log` takes them down, but of runs that were cut off, too."""
    known: dict[str, Knowledge] = {one.knowledge.id: one.knowledge for one in trace.beginnings}
    for number, one in enumerate(trace.changes):
        before: Any = known[one.component]
        after: Any = one.after
        known[one.component] = after
        if not (one.adaptation and isinstance(after, Deciding)):
            continue
        if words := after.decided_since(before):
            head = (*_head(one), number, one.by, words, one.peer or one.component)
            yield (*head, *(before.target or (None, None)), *(after.target or (None, None)))


def _json(value: object) -> str | None:
    if value is ABSENT:
        return None
    return msgspec.json.encode(value, enc_hook=repr, order="deterministic").decode()
