"""Result of a field trial; ground truth only with emulated devices."""

import math
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import (
    EVENT_COUNTERS,
    FieldTrial,
    FieldTrialError,
    Moment,
    RobotLog,
)
from acrc_testbed.results.outcome import nearest_rank, place_counts, robot_place_counts
from acrc_testbed.results.result import (
    ClockReport,
    RecordingReport,
    RobotResult,
    RunResult,
    field_trial_struct,
    octet_rate,
    robot_reports,
)
from actors.instant import Duration, in_seconds, seconds
from actors.items import ItemGivenUp, ItemKey
from actors.messages import Drive, RadioEvents
from actors.radio.frame import octets
from actors.runtime import regular_file, typed_json
from cleaning.place import VisitReport
from cleaning.referee import PlaceOutcome, PlaceVerdict, Referee

if TYPE_CHECKING:
    from firmware_bridge.laboratory.laboratory import LaboratoryResult

_SWITCH_OFF: Final[Duration] = seconds(30)
"""Robots that stopped at most so long before the last one count as running at the end, because they are
switched off one by one."""
_MAX_PLACES: Final = 10_000
"""Upper limit of place numbers of a robot without a recording."""


class ClaimedPlace(PlaceOutcome, frozen=True):
    """Final state of a place without ground truth: reports are unverified."""

    @property
    def verdict(self) -> PlaceVerdict:
        """Final state of the place."""
        return PlaceVerdict.CLAIMED if self.reported_at is not None else super().verdict


class ReportedPlaces(NamedTuple):
    """Final states of all places of a field trial."""

    places: tuple[PlaceOutcome, ...]
    """In the order of robots and their lists; x and y are NaN if only the place's number is known."""
    notes: tuple[str, ...]
    """Sentences on unknown data."""
    contacts: int | None = None
    """Number of contacts; None without ground truth."""


class _Owner(NamedTuple):
    id: str
    places: tuple[tuple[float, float], ...]


def reported_places(trial: FieldTrial, clocks: AlignedClocks) -> ReportedPlaces:
    """Return the final state of every place assigned or reported; instants since the start of the trial."""
    reports: list[tuple[int, str, VisitReport | ItemGivenUp]] = []
    for robot, logs in trial.logs.items():
        for log in logs:
            for tick, drive in log.messages_of(Drive):
                changes: tuple[VisitReport | ItemGivenUp, ...] = (*drive.reports, *drive.given_up)
                reports += [(clocks.instant(log, Moment(tick, one.instant)), robot, one) for one in changes]
    reports.sort(key=itemgetter(0))
    begin = clocks.begin
    known = {robot: logs[0].identity.places for robot, logs in trial.logs.items()}
    reported_keys = {(report.owner, report.place) for _, _, report in reports}
    place_numbers: dict[str, int] = {}
    for owner, place in reported_keys:
        if owner not in known and 0 <= place < _MAX_PLACES:
            place_numbers[owner] = max(place_numbers.get(owner, 0), place + 1)
    unknown = {owner: ((math.nan, math.nan),) * number for owner, number in sorted(place_numbers.items())}
    referee = Referee([_Owner(*one) for one in (known | unknown).items()], reach=0.0)
    unknown_places = 0
    for instant, robot, recorded in reports:
        report = msgspec.structs.replace(recorded, instant=instant - begin)
        if not referee.has_place(report):
            unknown_places += 1
        elif isinstance(report, VisitReport):
            referee.report(robot, report)
        else:
            referee.give_up(robot, report)
    places = (
        ClaimedPlace(**msgspec.structs.asdict(place))
        for place in referee.outcomes(_final_routes(trial, clocks))
        if place.owner in known or (place.owner, place.place) in reported_keys
    )
    notes = [
        f"{owner}: its list of places is unknown, so the table has only those in others' reports, without "
        "positions"
        for owner in unknown
    ]
    if unknown_places:
        notes.append(f"{unknown_places} reports were about places that do not exist, and are left out")
    return ReportedPlaces(tuple(places), tuple(notes))


def _final_routes(trial: FieldTrial, clocks: AlignedClocks) -> dict[str, tuple[ItemKey, ...]]:
    """Return the routes of the robots that were running at the end."""
    last = {
        robot: steps[-1]
        for robot, logs in trial.logs.items()
        if (steps := [log for log in logs if log.ticks])
    }
    ends = {
        robot: clocks.instant(log, Moment(len(log.ticks) - 1, log.ticks[-1].instant))
        for robot, log in last.items()
    }
    latest = max(ends.values())
    return {robot: _final_route(log) for robot, log in last.items() if latest - ends[robot] <= _SWITCH_OFF}


def _final_route(log: RobotLog) -> tuple[ItemKey, ...]:
    routes = [drive.route for _, drive in log.messages_of(Drive) if drive.route is not None]
    initial_route = tuple(ItemKey(log.identity.id, number) for number in range(len(log.identity.places)))
    return routes[-1] if routes else initial_route


def field_trial_result(
    trial: FieldTrial,
    clocks: AlignedClocks,
    reported: ReportedPlaces,
    out: Path | None,
    truth: "LaboratoryResult | None" = None,
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
        **place_counts(reported.places, has_truth=reported.contacts is not None),
        per_robot={
            robot: _robot(robot, trial, reported, frames[robot], segments[robot]) for robot in trial.logs
        },
        contacts=reported.contacts,
        frames=whole,
        radio_bytes_per_robot_s=sent_bytes,
        deeco=reports.deeco,
        reference=clocks.reference,
        notes=(*trial.notes, *clocks.notes, *reported.notes, *unknown, *reports.refused),
        out=None if out is None else str(out),
    )


def _robot(
    robot: str,
    trial: FieldTrial,
    reported: ReportedPlaces,
    frames: dict[str, int],
    clock: tuple[ClockReport, ...],
) -> RobotResult:
    logs, lateness = trial.logs[robot], trial.lateness_ms.get(robot)
    drives = [drive for log in logs for _, drive in log.messages_of(Drive)]
    return field_trial_struct(
        RobotResult,
        **robot_place_counts(reported.places, robot, has_truth=reported.contacts is not None),
        reports=sum(len(drive.reports) for drive in drives),
        gave_up=sum(len(drive.given_up) for drive in drives),
        frames=frames,
        lateness_p50_ms=None if lateness is None else nearest_rank(lateness, 50),
        lateness_p99_ms=None if lateness is None else nearest_rank(lateness, 99),
        overruns=trial.overruns.get(robot),
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


def with_ground_truth(
    reported: ReportedPlaces, truth: "LaboratoryResult", clocks: AlignedClocks
) -> ReportedPlaces:
    """Return the places with the instant and robot of their true first visit.

    Devices are emulated on the robots' machine, so they share the reference robot's clock. Raises
    FieldTrialError if the times of emulation and field trial do not overlap.
    """
    ahead = truth.began_us - clocks.begin
    if not -(truth.simulated_s * 1e6 + truth.lost_ms * 1e3) <= ahead <= clocks.span:
        raise FieldTrialError(
            f"--truth: the emulation began {ahead / 1e6:.0f} s after the field trial and lasted "
            f"{truth.simulated_s:.0f} s; give the result of the same field trial"
        )
    known = {(place.owner, place.place): place for place in truth.places}
    places = tuple(
        _with_first_visit(place, known.get((place.owner, place.place)), ahead) for place in reported.places
    )
    notes = list(reported.notes)
    if truth.lost_ms:
        notes.append(f"the emulation fell behind, so the true instants are early by up to {truth.lost_ms} ms")
    return ReportedPlaces(places, tuple(notes), contacts=truth.contacts)


def _with_first_visit(reported: PlaceOutcome, true: PlaceOutcome | None, ahead: int) -> PlaceOutcome:
    """Return a reported place with its true first visit."""
    if true is None:
        return reported
    fields = msgspec.structs.asdict(reported)
    reached = None if true.reached_at is None else true.reached_at + ahead
    return PlaceOutcome(**fields | {"reached_at": reached, "reached_by": true.reached_by})


def _true_frames(reported: dict[str, int], true: dict[str, int]) -> dict[str, int]:
    never_sent = ("frames_overflowed", "frames_refused")
    return reported | true | {name: max(reported.get(name, 0), true.get(name, 0)) for name in never_sent}
