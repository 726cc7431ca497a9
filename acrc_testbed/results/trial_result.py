"""Result of a field trial: as of a simulated run, without ground truth unless a laboratory supplies it."""

import math
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import (
    FRAME_OUTCOMES,
    FieldTrial,
    FieldTrialError,
    Moment,
    RobotLog,
)
from acrc_testbed.results.outcome import (
    counted,
    nearest_rank,
    robot_places,
)
from acrc_testbed.results.result import (
    ClockReport,
    RecordingReport,
    RobotResult,
    RunResult,
    rate,
    robot_reports,
    without_unknown,
)
from actors.instant import Duration, in_seconds, seconds
from actors.messages import Drive, Received
from actors.radio.frame import octets
from actors.runtime import regular_file, typed_json
from actors.task.referee import PlaceOutcome, Referee, Verdict
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport

if TYPE_CHECKING:
    from firmware_bridge.laboratory.laboratory import LaboratoryResult

_TOGETHER: Final[Duration] = seconds(30)
"""A robot whose last step is so much before the last one of all still takes part at the end: people switch
one off after the other."""
_MOST_PLACES: Final = 10_000
"""Of a robot whose list is not known."""


class ClaimedPlace(PlaceOutcome, frozen=True):
    """State of a place without ground truth: a report is neither true nor mistaken."""

    @property
    def verdict(self) -> Verdict:
        """Its state in one word."""
        return Verdict.CLAIMED if self.reported_at is not None else super().verdict


class ReportedPlaces(NamedTuple):
    """All places of a field trial."""

    places: tuple[PlaceOutcome, ...]
    """In the order of robots and lists; x and y are NaN where only the place's number is known."""
    notes: tuple[str, ...]
    """What is not known, a sentence each."""
    contacts: int | None = None
    """Contacts that began; None without ground truth."""


class _Owner(NamedTuple):
    id: str
    places: tuple[tuple[float, float], ...]


def reported_places(trial: FieldTrial, clocks: AlignedClocks) -> ReportedPlaces:
    """Return the final state of every place that a robot was given or reported; instants since the begin."""
    words: list[tuple[int, str, PlaceReport | PlaceGivenUp]] = []
    for robot, logs in trial.logs.items():
        for log in logs:
            for tick, drive in log.of(Drive):
                said: tuple[PlaceReport | PlaceGivenUp, ...] = (*drive.reports, *drive.given_up)
                words += [(clocks.instant(log, Moment(tick, one.instant)), robot, one) for one in said]
    words.sort(key=itemgetter(0))
    begin = clocks.begin
    known = {robot: logs[0].identity.places for robot, logs in trial.logs.items()}
    spoken = {(word.owner, word.place) for _, _, word in words}
    most: dict[str, int] = {}
    for owner, place in spoken:
        if owner not in known and 0 <= place < _MOST_PLACES:
            most[owner] = max(most.get(owner, 0), place + 1)
    unknown = {owner: ((math.nan, math.nan),) * number for owner, number in sorted(most.items())}
    referee = Referee([_Owner(*one) for one in (known | unknown).items()], reach=0.0)
    outside = 0
    for instant, robot, told in words:
        word = msgspec.structs.replace(told, instant=instant - begin)
        if not referee.knows(word):
            outside += 1
        elif isinstance(word, PlaceReport):
            referee.report(robot, word)
        else:
            referee.give_up(robot, word)
    places = (
        ClaimedPlace(**msgspec.structs.asdict(place))
        for place in referee.outcomes(_routes(trial, clocks))
        if place.owner in known or (place.owner, place.place) in spoken
    )
    notes = [
        f"{owner}: its list of places is not known, so the table has those that others spoke of, without "
        "where they are"
        for owner in unknown
    ]
    if outside:
        notes.append(f"{outside} words were about places that there are not, and are left out")
    return ReportedPlaces(tuple(places), tuple(notes))


def _routes(trial: FieldTrial, clocks: AlignedClocks) -> dict[str, tuple[PlaceKey, ...]]:
    """Return the routes of the robots that take part at the end."""
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
    return {robot: _route(log) for robot, log in last.items() if latest - ends[robot] <= _TOGETHER}


def _route(log: RobotLog) -> tuple[PlaceKey, ...]:
    said = [drive.route for _, drive in log.of(Drive) if drive.route is not None]
    given = tuple(PlaceKey(log.identity.id, number) for number in range(len(log.identity.places)))
    return said[-1] if said else given


def trial_result(
    trial: FieldTrial,
    clocks: AlignedClocks,
    told: ReportedPlaces,
    out: Path | None,
    truth: "LaboratoryResult | None" = None,
) -> RunResult:
    """Compute the result of the robots' recordings.

    With a laboratory's `truth`, frames have the causes of a simulated run; those that a board or its line
    never sent are as the robots counted them.
    """
    ended = [(log.identity.id, log.path, log.final) for log in trial.all_logs() if log.final is not None]
    missing = [log.path for log in trial.all_logs() if log.final is None]
    unknown = (f"{path}: has no last record, so what its node did is not known" for path in missing)
    reports = robot_reports(ended)
    frames = {robot: _frames(logs) for robot, logs in trial.logs.items()}
    names = next(iter(frames.values()))
    whole = {name: sum(counts[name] for counts in frames.values()) for name in names}
    segments = {robot: clocks.reports(robot) for robot in trial.logs}
    robot_seconds = sum(one.to_s - one.from_s for parts in segments.values() for one in parts)
    sent_bytes = rate(whole["bytes_sent"], robot_seconds)
    if truth is not None:
        by_robot = truth.frames_by_robot
        frames = {robot: _true_frames(counts, by_robot.get(robot, {})) for robot, counts in frames.items()}
        whole = _true_frames(whole, truth.frames)
    return without_unknown(
        RunResult,
        robots=len(trial.logs),
        duration_s=in_seconds(Duration(clocks.span)),
        **counted(told.places, watched=told.contacts is not None),
        per_robot={robot: _robot(robot, trial, told, frames[robot], segments[robot]) for robot in trial.logs},
        contacts=told.contacts,
        frames=whole,
        radio_bytes_per_robot_s=sent_bytes,
        deeco=reports.deeco,
        reference=clocks.reference,
        notes=(*trial.notes, *clocks.notes, *told.notes, *unknown, *reports.refused),
        out=None if out is None else str(out),
    )


def _robot(
    robot: str,
    trial: FieldTrial,
    told: ReportedPlaces,
    frames: dict[str, int],
    clock: tuple[ClockReport, ...],
) -> RobotResult:
    logs, lateness = trial.logs[robot], trial.lateness_ms.get(robot)
    drives = [drive for log in logs for _, drive in log.of(Drive)]
    return without_unknown(
        RobotResult,
        **robot_places(told.places, robot, watched=told.contacts is not None),
        reports=sum(len(drive.reports) for drive in drives),
        gave_up=sum(len(drive.given_up) for drive in drives),
        frames=frames,
        lateness_p50_ms=None if lateness is None else nearest_rank(lateness, 50),
        lateness_p99_ms=None if lateness is None else nearest_rank(lateness, 99),
        overruns=trial.overruns.get(robot),
        clock=clock,
        recordings=tuple(_recording(log) for log in logs),
    )


def _frames(logs: Sequence[RobotLog]) -> dict[str, int]:
    """Count frames by outcome, by the robot's own messages."""
    frames = dict.fromkeys(("frames_handed", *FRAME_OUTCOMES.values(), "bytes_sent"), 0)
    for log in logs:
        frames["frames_handed"] += sum(drive.transmits for _, drive in log.of(Drive))
        for _, received in log.of(Received):
            for event in received.events:
                frames[FRAME_OUTCOMES[type(event)]] += 1
        confirmed = (frame for frame in log.sent_frames() if frame.sent is not None)
        frames["bytes_sent"] += sum(octets(len(frame.data)) for frame in confirmed)
    return frames


def _recording(log: RobotLog) -> RecordingReport:
    if log.damage is not None:
        ended = "damaged"
    elif log.failure is not None:
        ended = "failed"
    else:
        ended = "cut short" if log.final is None else "as planned"
    return RecordingReport(str(log.path), log.identity.epoch, len(log.ticks), ended)


def read_truth(path: Path) -> "LaboratoryResult":
    """A laboratory's result. Raises FieldTrialError."""
    from firmware_bridge.laboratory.laboratory import LaboratoryResult  # needs physics

    try:
        return typed_json.decode(regular_file.read_bytes(path), LaboratoryResult)
    except (OSError, ValueError) as error:
        raise FieldTrialError(f"--truth: {path} is no result of a laboratory: {error}") from None


def with_truth(told: ReportedPlaces, truth: "LaboratoryResult", clocks: AlignedClocks) -> ReportedPlaces:
    """The places with when they were truly reached, s of the field trial, and by whom.

    The laboratory plays the devices of robots on its own machine, so that the clock of the reference robot is
    its own, too. Raises FieldTrialError if the field trial lies outside of the laboratory's time.
    """
    ahead = truth.began_us - clocks.begin
    if not -(truth.simulated_s * 1e6 + truth.lost_ms * 1e3) <= ahead <= clocks.span:
        raise FieldTrialError(
            f"--truth: the laboratory began {ahead / 1e6:.0f} s after the field trial and went on for "
            f"{truth.simulated_s:.0f} s; it should be that of this field trial"
        )
    known = {(place.owner, place.place): place for place in truth.places}
    places = tuple(_judged(place, known.get((place.owner, place.place)), ahead) for place in told.places)
    notes = list(told.notes)
    if truth.lost_ms:
        notes.append(
            f"the laboratory fell behind, so the true instants are early by up to {truth.lost_ms} ms"
        )
    return ReportedPlaces(places, tuple(notes), contacts=truth.contacts)


def _judged(told: PlaceOutcome, true: PlaceOutcome | None, ahead: int) -> PlaceOutcome:
    """One place as said, with what is true of it."""
    if true is None:
        return told
    said = msgspec.structs.asdict(told)
    reached = None if true.reached_at is None else true.reached_at + ahead
    return PlaceOutcome(**said | {"reached_at": reached, "reached_by": true.reached_by})


def _true_frames(told: dict[str, int], true: dict[str, int]) -> dict[str, int]:
    never_sent = ("frames_overflowed", "frames_refused")
    return told | true | {name: max(told.get(name, 0), true.get(name, 0)) for name in never_sent}
