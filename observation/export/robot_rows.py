"""The rows of one process of a robot, from its trace.

Cells stand in the order of a table's columns, without `robot` and `process`; what only others know is added
by `rows`: of an estimate its error, of an exchange the robot behind the address in `via`.
"""

from collections.abc import Iterator
from typing import Any, Final

from actors.instant import in_seconds
from observation.trace.rows import KnowledgeChange, Trace

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
