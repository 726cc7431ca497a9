"""Result of a field trial; ground truth only with emulated devices."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import (
    EVENT_COUNTERS,
    FieldTrial,
    FieldTrialError,
    RobotLog,
)
from acrc_testbed.results.outcome import nearest_rank
from acrc_testbed.results.result import (
    ClockReport,
    RecordingReport,
    RobotResult,
    RunResult,
    field_trial_struct,
    octet_rate,
    robot_reports,
)
from acrc_testbed.results.trial_judgement import TrialVerdict
from actors.instant import Duration, in_seconds
from actors.messages import Drive, RadioEvents
from actors.radio.frame import octets
from actors.runtime import regular_file, typed_json

if TYPE_CHECKING:
    from firmware_bridge.laboratory.laboratory import LaboratoryResult


def field_trial_result(
    trial: FieldTrial,
    clocks: AlignedClocks,
    judgement: TrialVerdict,
    out: Path | None,
    truth: "LaboratoryResult | None",
) -> RunResult:
    """Compute the result from the robots' recordings.

    With `truth` from emulated devices, frames have the outcomes of a simulated run, except those that a board
    or its serial line did not send, which robots count.
    """
    ended = [(log.identity.id, log.path, log.final) for log in trial.all_logs() if log.final is not None]
    missing = [log.path for log in trial.all_logs() if log.final is None]
    unknown = (f"{path}: no final record, so the counters of its node are unknown" for path in missing)
    reports = robot_reports(ended)
    frames = {robot: _frame_counts(logs) for robot, logs in trial.logs.items()}
    names = next(iter(frames.values()))
    whole = {name: sum(counts[name] for counts in frames.values()) for name in names}
    segments = {robot: clocks.reports(robot) for robot in trial.logs}
    robot_seconds = sum(one.to_s - one.from_s for parts in segments.values() for one in parts)
    sent_bytes = octet_rate(whole["bytes_sent"], robot_seconds)
    if truth is not None:
        by_robot = truth.frames_by_robot
        frames = {robot: _true_frames(counts, by_robot.get(robot, {})) for robot, counts in frames.items()}
        whole = _true_frames(whole, truth.frames)
    return field_trial_struct(
        RunResult,
        robots=len(trial.logs),
        duration_s=in_seconds(Duration(clocks.span)),
        task=dict(judgement.outcome.values),
        task_summary=judgement.outcome.summary,
        task_notes=judgement.outcome.notes,
        declaration=judgement.declaration,
        per_robot={
            robot: _robot(robot, trial, judgement, frames[robot], segments[robot]) for robot in trial.logs
        },
        contacts=None if truth is None else truth.contacts,
        frames=whole,
        radio_bytes_per_robot_s=sent_bytes,
        deeco=reports.deeco,
        reference=clocks.reference,
        notes=(*trial.notes, *clocks.notes, *judgement.notes, *unknown, *reports.refused),
        out=None if out is None else str(out),
    )


def _robot(
    robot: str,
    trial: FieldTrial,
    judgement: TrialVerdict,
    frames: dict[str, int],
    clock: tuple[ClockReport, ...],
) -> RobotResult:
    logs, lateness = trial.logs[robot], trial.lateness_ms.get(robot)
    trips = trial.round_trips_ms.get(robot)
    drives = [drive for log in logs for _, drive in log.messages_of(Drive)]
    return field_trial_struct(
        RobotResult,
        task=dict(judgement.outcome.robots.get(robot, {})),
        reports=sum(len(drive.reports) for drive in drives),
        gave_up=sum(len(drive.given_up) for drive in drives),
        frames=frames,
        lateness_p50_ms=None if lateness is None else nearest_rank(lateness, 50),
        lateness_p99_ms=None if lateness is None else nearest_rank(lateness, 99),
        overruns=trial.overruns.get(robot),
        round_trip_p50_ms=nearest_rank(trips, 50) if trips else None,
        round_trip_p99_ms=nearest_rank(trips, 99) if trips else None,
        clock=clock,
        recordings=tuple(_recording_report(log) for log in logs),
    )


def _frame_counts(logs: Sequence[RobotLog]) -> dict[str, int]:
    """Count frames by outcome, from the robot's own messages."""
    frames = dict.fromkeys(("frames_handed", *EVENT_COUNTERS.values(), "bytes_sent"), 0)
    for log in logs:
        frames["frames_handed"] += sum(drive.transmits for _, drive in log.messages_of(Drive))
        for _, received in log.messages_of(RadioEvents):
            for event in received.events:
                frames[EVENT_COUNTERS[type(event)]] += 1
        confirmed = (frame for frame in log.sent_frames() if frame.sent is not None)
        frames["bytes_sent"] += sum(octets(len(frame.data)) for frame in confirmed)
    return frames


def _recording_report(log: RobotLog) -> RecordingReport:
    if log.damage is not None:
        ended = "damaged"
    elif log.failure is not None:
        ended = "failed"
    else:
        ended = "cut short" if log.final is None else "as planned"
    return RecordingReport(str(log.path), log.identity.epoch, len(log.ticks), ended)


def read_ground_truth(path: Path) -> "LaboratoryResult":
    """Read the ground truth of emulated devices. Raises FieldTrialError."""
    from firmware_bridge.laboratory.laboratory import LaboratoryResult  # needs physics

    try:
        return typed_json.decode(regular_file.read_bytes(path), LaboratoryResult)
    except (OSError, ValueError) as error:
        raise FieldTrialError(f"--truth: {path} is not a result of emulated devices: {error}") from None


def _true_frames(reported: dict[str, int], true: dict[str, int]) -> dict[str, int]:
    never_sent = ("frames_overflowed", "frames_refused")
    return reported | true | {name: max(reported.get(name, 0), true.get(name, 0)) for name in never_sent}
