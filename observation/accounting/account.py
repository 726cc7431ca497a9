"""Where the time of a simulated run went, from the folder that it has left."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from actors.instant import in_seconds
from actors.robot_model import load_model
from observation.accounting import blockings, decisions, diagnosis
from observation.accounting.classify import CAUSES, Classified, classify
from observation.accounting.episodes import STANDARD, EpisodeParameters
from observation.accounting.findings import findings
from observation.accounting.passage import Passages
from observation.accounting.said import Said, said_by
from observation.accounting.time_spent import TimeSpent
from observation.accounting.tracks import Tracks, tracks_of
from observation.evidence.recorded import outcome
from observation.evidence.run_evidence import RunEvidence
from observation.evidence.run_reader import read_run
from observation.replay.run_recordings import recordings


class Judged(NamedTuple):
    """A run, and what each step of each robot went into."""

    tracks: Tracks
    said: Mapping[str, Said]
    causes: Classified


def judge(run: RunEvidence, parameters: EpisodeParameters = STANDARD) -> Judged:
    """What every robot's time went into. Raises RecordingError or OutcomeError if the run is damaged."""
    files = recordings(run.out)
    said = {
        robot: said_by([path for path in files.values() if path.parent.name == robot]) for robot in run.robots
    }
    radius = max(load_model(robot.model).footprint.circumradius for robot in run.setup.robots)
    tracks = tracks_of(run)
    passages = Passages(run.grid, radius, parameters.neck)
    return Judged(tracks, said, classify(tracks, said, passages, parameters))


def account(out: Path, parameters: EpisodeParameters = STANDARD) -> TimeSpent:
    """Where the time went of the run in the folder `out`.

    Raises EvidenceError if that holds no simulated run, and RecordingError or OutcomeError if it is damaged.
    """
    tracks, said, classified = judge(read_run(out), parameters)
    return TimeSpent(
        robots=_robots(tracks, classified),
        blockings=blockings.events(tracks, classified, parameters),
        diagnosis=diagnosis.score(tracks, said, classified),
        decisions=decisions.events(tracks, said, classified, parameters),
        decisions_left_out=sum(one.left_out for one in said.values()),
        findings=findings(tracks, _frames(recordings(out)["radio"]), parameters),
        wedges=blockings.wedges(tracks, classified, parameters),
    )


def _robots(tracks: Tracks, classified: Classified) -> dict[str, dict[str, float]]:
    """In s, from whole µs: each robot's add up to the run's time."""
    spent = {}
    for index, robot in enumerate(tracks.robots):
        steps = np.bincount(classified.causes[:, index], minlength=len(CAUSES)).tolist()
        spent[robot] = {
            cause.value: in_seconds(count * tracks.step_us)
            for cause, count in zip(CAUSES, steps, strict=True)
        }
    return spent


def _frames(radio: Path) -> Mapping[str, Mapping[str, int]]:
    return outcome(radio, "frames_by_robot", dict[str, dict[str, int]], "a radio") or {}
