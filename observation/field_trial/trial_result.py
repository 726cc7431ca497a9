"""What a field trial comes to: the result of a run whose truth nobody knows."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import msgspec

from actors.instant import Duration, in_seconds
from actors.radio.frame import octets
from actors.task.referee import PlaceOutcome
from observation.field_trial.aligned_clocks import AlignedClocks, ClockReport
from observation.field_trial.node_counts import node_account
from observation.field_trial.recordings import FieldTrial
from observation.field_trial.reported_places import ReportedPlaces
from observation.field_trial.robot_log import FRAME_OUTCOMES, RobotLog
from observation.results.deeco_result import DeecoResult, deeco_result, nearest_rank
from observation.results.place_table import counted
from observation.results.result import rate


class RecordingReport(msgspec.Struct, frozen=True):
    """One recording of a robot."""

    path: str
    epoch: int
    steps: int
    ended: str
    """"as planned", "failed", "cut short" or "damaged"."""


class RobotTrial(msgspec.Struct, frozen=True):
    """One robot's part; the fields that RobotResult has, too, mean the same."""

    places_total: int
    places_done: int | None
    """None where nobody watched."""
    places_claimed: int
    places_given_up: int
    completion_s: float | None
    """When the last of its places was reported, as for all; 0 if it has none."""
    reports: int
    """Places, whosever, of which it said that it had visited them."""
    gave_up: int
    """Places, whosever, that it gave up."""
    frames: dict[str, int]
    """What became of its frames, and how many of others it has heard."""
    lateness_p50_ms: int | None
    """From a step's instant to the robot's answer, whole ms; None where its base has left no word."""
    lateness_p99_ms: int | None
    overruns: int | None
    """Steps that its base left out because it had not answered."""
    clock: tuple[ClockReport, ...]
    recordings: tuple[RecordingReport, ...]


class TrialResult(msgspec.Struct, frozen=True):
    """The result of a field trial; the fields that RunResult has, too, mean the same but for truth."""

    robots: int
    duration_s: float
    """From the first step of the first robot to the last step of the last one."""
    places_total: int
    places_done: int | None
    """None where nobody watched."""
    places_claimed: int
    places_given_up: int
    places_lost: int
    completion_s: float | None
    """When the last place was reported; None unless all were, and truly so if somebody watched."""
    settled_s: float | None
    last_reached_s: float | None
    per_robot: dict[str, RobotTrial]
    contacts: int | None
    """None where nobody watched."""
    frames: dict[str, int]
    """What became of the robots' frames, over all of them, and the octets of those that were sent."""
    radio_bytes_per_robot_s: float
    deeco: DeecoResult
    reference: str
    """The robot whose clock gives the time."""
    notes: tuple[str, ...]
    """What is missing or not known, a sentence each."""
    out: str | None


def trial_result(
    trial: FieldTrial, clocks: AlignedClocks, told: ReportedPlaces, out: Path | None
) -> TrialResult:
    """What the robots' recordings come to."""
    accounts = [node_account(log) for log in trial.all_logs()]
    frames = {robot: _frames(logs) for robot, logs in trial.logs.items()}
    whole = Counter[str]()
    for part in frames.values():
        whole.update(part)
    places = counted(told.places)
    segments = {robot: clocks.reports(robot) for robot in trial.logs}
    robot_seconds = sum(one.to_s - one.from_s for parts in segments.values() for one in parts)
    return TrialResult(
        robots=len(trial.logs),
        duration_s=in_seconds(Duration(clocks.span)),
        places_total=places.total,
        places_done=None if told.contacts is None else places.done,
        places_claimed=places.claimed,
        places_given_up=places.given_up,
        places_lost=places.lost,
        completion_s=_completion(told.places) if told.contacts is None else places.completion_s,
        settled_s=places.settled_s,
        last_reached_s=places.last_reached_s,
        per_robot={robot: _robot(robot, trial, told, frames[robot], segments[robot]) for robot in trial.logs},
        contacts=told.contacts,
        frames=dict(whole),
        radio_bytes_per_robot_s=rate(whole["bytes_sent"], robot_seconds),
        deeco=deeco_result(account.node for account in accounts if account.node is not None),
        reference=clocks.reference,
        notes=(*trial.notes, *clocks.notes, *told.notes, *(note for one in accounts for note in one.notes)),
        out=None if out is None else str(out),
    )


def _robot(
    robot: str,
    trial: FieldTrial,
    told: ReportedPlaces,
    frames: dict[str, int],
    clock: tuple[ClockReport, ...],
) -> RobotTrial:
    own = [place for place in told.places if place.owner == robot]
    part, logs = counted(own), trial.logs[robot]
    drives = [drive for log in logs for _, drive in log.drives]
    lateness = trial.lateness_ms.get(robot)
    return RobotTrial(
        places_total=part.total,
        places_done=None if told.contacts is None else part.done,
        places_claimed=part.claimed,
        places_given_up=part.given_up,
        completion_s=_completion(own) if told.contacts is None else part.completion_s,
        reports=sum(len(drive.reports) for drive in drives),
        gave_up=sum(len(drive.given_up) for drive in drives),
        frames=frames,
        lateness_p50_ms=None if lateness is None else nearest_rank(lateness, 50),
        lateness_p99_ms=None if lateness is None else nearest_rank(lateness, 99),
        overruns=trial.overruns.get(robot),
        clock=clock,
        recordings=tuple(_recording(log) for log in logs),
    )


def _completion(places: Sequence[PlaceOutcome]) -> float | None:
    """When the last of the places was reported, s; None if not all were; 0 if there are none."""
    reported = [place.reported_at for place in places if place.reported_at is not None]
    return in_seconds(Duration(max(reported, default=0))) if len(reported) == len(places) else None


def _frames(logs: Sequence[RobotLog]) -> dict[str, int]:
    frames = {"frames_handed": sum(log.frames_handed for log in logs)}
    frames |= {name: sum(log.events[name] for log in logs) for name in FRAME_OUTCOMES.values()}
    sent = (frame for log in logs for frame in log.sent if frame.sent is not None)
    frames["bytes_sent"] = sum(octets(len(frame.data)) for frame in sent)
    return frames


def _recording(log: RobotLog) -> RecordingReport:
    if log.damage is not None:
        ended = "damaged"
    elif log.failure is not None:
        ended = "failed"
    else:
        ended = "cut short" if log.final is None else "as planned"
    return RecordingReport(str(log.path), log.identity.epoch, len(log.ticks), ended)
