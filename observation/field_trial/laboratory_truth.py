"""What truly happened on a field trial in the laboratory, beside what the robots say."""

from pathlib import Path
from typing import Final

import msgspec

from actors.runtime import regular_file, typed_json
from actors.task.referee import PlaceOutcome
from firmware_bridge.laboratory.laboratory_setup import LaboratoryResult
from observation.field_trial.aligned_clocks import AlignedClocks
from observation.field_trial.recordings import FieldTrialError
from observation.field_trial.reported_places import ReportedPlaces
from observation.field_trial.trial_result import TrialResult

BEFORE_THE_AIR: Final = ("frames_overflowed", "frames_refused")
"""Ends that a frame may come to in front of its transceiver."""


def read_truth(path: Path) -> LaboratoryResult:
    """A laboratory's result. Raises FieldTrialError."""
    try:
        return typed_json.decode(regular_file.content(path), LaboratoryResult)
    except (OSError, ValueError) as error:
        raise FieldTrialError(f"--truth: {path} is no result of a laboratory: {error}") from None


def with_truth(told: ReportedPlaces, truth: LaboratoryResult, clocks: AlignedClocks) -> ReportedPlaces:
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


def with_true_frames(result: TrialResult, truth: LaboratoryResult) -> TrialResult:
    """The result with what truly became of all frames, by the causes of a simulated run.

    What a board, or the line to it, never gave to the air stands as the robots were told.
    """
    robots = {
        robot: msgspec.structs.replace(
            part, frames=_true_frames(part.frames, truth.frames_by_robot.get(robot, {}))
        )
        for robot, part in result.per_robot.items()
    }
    return msgspec.structs.replace(result, frames=_true_frames(result.frames, truth.frames), per_robot=robots)


def _true_frames(told: dict[str, int], true: dict[str, int]) -> dict[str, int]:
    before = {name: max(told.get(name, 0), true.get(name, 0)) for name in BEFORE_THE_AIR}
    return told | true | before
