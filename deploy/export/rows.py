"""The rows of an export's tables: from the recordings, and from executing radio and robots again."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from actors.instant import in_seconds
from actors.messages import TRUTH
from actors.robot.behaviour.decision_log import Deciding
from actors.runtime.process import RunNote
from actors.runtime.recording import decoded, read_notes
from deeco.knowledge import Knowledge
from deploy.evidence.drive_trace import DriveTrace
from deploy.evidence.frame_fates import FrameFate, frame_fates
from deploy.evidence.knowledge_trace import ABSENT, KnowledgeChange, KnowledgeTrace, trace_knowledge
from deploy.evidence.recorded import taken
from deploy.evidence.run_evidence import RunEvidence, read_run
from deploy.replay.run_recordings import recordings

Row = tuple[Any, ...]
"""Its cells, in the order of the table's columns."""
Tables = dict[str, list[Row]]


class _RadioSetup(msgspec.Struct):
    """What is needed here of what the radio was told (`actors.radio.radio_setup`)."""

    robots: tuple[tuple[str, int], ...]


def tables(out: Path, on_actor: Callable[[str], object] = lambda actor: None) -> Tables:
    """Every table of a simulated run, by its name; `on_actor` is told whom it is that is executed again.

    Runs the recorded strategies in this process. Raises RecordingError and EvidenceError for what is no
    whole folder of a run, ReplayError where somebody does not do again what he did.
    """
    run, files = read_run(out), recordings(out)
    found: Tables = {"poses": list(_poses(files["radio"])), "places": list(_places(run))}
    on_actor("radio")
    found["frames"] = [row for number, one in enumerate(frame_fates(out)) for row in _frame(number, one)]
    told = decoded(files["radio"], "run", read_notes(files["radio"])["run"], RunNote)
    addresses = {number: name for name, number in msgspec.json.decode(told.scenario, type=_RadioSetup).robots}
    for actor, path in files.items():
        if actor not in ("world", "radio"):
            on_actor(actor)
            for name, rows in _executed(_Robot(run, path.parent.name, actor, addresses)).items():
                found.setdefault(name, []).extend(rows)
    return found | {
        name: sorted(found.get(name, ()), key=lambda row: int(row[0]))
        for name in ("estimates", "goals", "knowledge", "exchanges", "decisions")
    }


@dataclass(frozen=True)
class _Robot:
    """One process of a robot."""

    run: RunEvidence
    name: str
    actor: str
    addresses: dict[int, str]

    def head(self, step: int, instant: int | None = None) -> Row:
        """The first cells of a row."""
        us = step * self.run.setup.step_us if instant is None else instant
        return (step, us / 1e6, self.name, self.actor)


def _executed(robot: _Robot) -> Tables:
    drive = DriveTrace()
    trace = trace_knowledge(robot.run.out, robot.actor, prepare=drive.prepare)
    return {
        "estimates": list(_estimates(robot, drive)),
        "goals": list(_goals(robot, drive)),
        "knowledge": list(_knowledge(robot, trace.changes)),
        "exchanges": list(_exchanges(robot, trace.changes)),
        "decisions": list(_decisions(robot, trace)),
    }


def _poses(radio: Path) -> Iterator[Row]:
    for _, truth in taken(radio, TRUTH):
        if not truth.halt:
            for one in truth.robots:
                where = (one.x, one.y, one.heading, one.vx, one.vy, one.omega)
                yield (truth.step, truth.instant / 1e6, one.id, *where, one.stepping, one.powered)


def _estimates(robot: _Robot, drive: DriveTrace) -> Iterator[Row]:
    index, true = robot.run.robots.index(robot.name), robot.run.true
    for step, estimate in drive.held:
        pose, spread = estimate.pose, estimate.covariance
        if step < len(true):
            x, y, _ = true[step, index].tolist()
            error = ((pose.x - x) ** 2 + (pose.y - y) ** 2) ** 0.5
            variances = (spread[0], spread[4], spread[8])
            yield (*robot.head(step), *pose, estimate.located, *variances, estimate.lost, error)


def _goals(robot: _Robot, drive: DriveTrace) -> Iterator[Row]:
    for step, goal in drive.goals:
        if goal is None:
            yield (*robot.head(step), None, None, None, None, None)
        else:
            words = (one and one.value for one in (goal.status, goal.reason, goal.phase))
            yield (*robot.head(step), goal.point.x, goal.point.y, *words)


def _frame(number: int, one: FrameFate) -> Iterator[Row]:
    head = (number, one.robot, one.tag, one.handed / 1e6, one.ended / 1e6, one.size, one.fate)
    if not one.copies:
        yield (*head, None, None, None)
    for copy in one.copies:
        yield (*head, copy.robot, copy.fate, copy.strength_dbm)


def _knowledge(robot: _Robot, changes: Iterable[KnowledgeChange]) -> Iterator[Row]:
    for number, one in enumerate(changes):
        head = (*robot.head(one.step, one.instant), one.component, number, one.by, one.adaptation)
        for path, before, after in one.changed:
            yield (*head, path, _json(before), _json(after))


def _exchanges(robot: _Robot, changes: Iterable[KnowledgeChange]) -> Iterator[Row]:
    for number, one in enumerate(changes):
        if not one.peer:
            continue
        head = (*robot.head(one.step, one.instant), one.component, number, one.by, one.peer)
        read = one.read
        if read is None:
            yield (*head, None, None, None, None, None, None, None)
        else:
            via = None if read.arrival is None else robot.addresses.get(read.arrival.sender)
            when = (in_seconds(read.heard), in_seconds(read.age))
            yield (*head, read.epoch, read.publication, *when, read.hops, read.rssi_dbm, via)


def _places(run: RunEvidence) -> Iterator[Row]:
    judged = run.result is not None
    for one in run.places:
        yield (
            one.owner, one.place, one.x, one.y, one.given_at / 1e6, one.verdict.value if judged else None,
            _second(one.reached_at), one.reached_by, _second(one.reported_at), one.reported_by,
            _second(one.given_up_at), one.given_up_by, one.reason,
        )  # fmt: skip


def _decisions(robot: _Robot, trace: KnowledgeTrace) -> Iterator[Row]:
    """As `actors.robot.behaviour.decision_log` takes them down, but of runs that were cut off, too."""
    known: dict[str, Knowledge] = {one.knowledge.id: one.knowledge for one in trace.beginnings}
    for number, one in enumerate(trace.changes):
        before: Any = known[one.component]
        after: Any = one.after
        known[one.component] = after
        if not (one.adaptation and isinstance(after, Deciding)):
            continue
        if words := after.decided_since(before):
            head = (*robot.head(one.step, one.instant), number, one.by, words, one.peer or one.component)
            yield (*head, *(before.target or (None, None)), *(after.target or (None, None)))


def _second(instant: int | None) -> float | None:
    return None if instant is None else instant / 1e6


def _json(value: object) -> str | None:
    if value is ABSENT:
        return None
    return msgspec.json.encode(value, enc_hook=repr, order="deterministic").decode()
