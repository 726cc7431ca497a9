"""Where the time of a simulated run went, from the folder that it has left."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from actors.instant import in_seconds
from observation.accounting import blockings, decisions, diagnosis
from observation.accounting.classify import CAUSES, Classified, classify
from observation.accounting.episodes import STANDARD, EpisodeParameters
from observation.accounting.findings import FrameCounts, findings
from observation.accounting.said import Said, said_by
from observation.accounting.time_spent import Blame, TimeSpent
from observation.accounting.tracks import Tracks, tracks_of
from observation.accounting.true_floor import TrueFloor
from observation.accounting.waiting import NOBODY
from observation.evidence.run_evidence import RunEvidence, largest_radius
from observation.evidence.run_reader import read_run
from observation.replay.run_recordings import all_recordings, recordings


class Judged(NamedTuple):
    """A run, and what each step of each robot went into."""

    tracks: Tracks
    floor: TrueFloor
    said: Mapping[str, Said]
    causes: Classified


def judge(run: RunEvidence, parameters: EpisodeParameters = STANDARD) -> Judged:
    """What every robot's time went into. Raises RecordingError or OutcomeError if the run is damaged.

    Of a robot whose recordings are on a host still, by what can be seen from outside.
    """
    files = recordings(run.out)
    said = {
        robot: said_by([path for path in files.values() if path.parent.name == robot]) for robot in run.robots
    }
    tracks = tracks_of(run)
    floor = TrueFloor(run.grid, largest_radius(run.setup), run.orders, parameters)
    return Judged(tracks, floor, said, classify(tracks, said, floor, parameters))


def account(out: Path, parameters: EpisodeParameters = STANDARD) -> TimeSpent:
    """Where the time went of the run in the folder `out`.

    Raises EvidenceError if that holds no simulated run, and RecordingError or OutcomeError if it is damaged.
    """
    all_recordings(out)
    run = read_run(out)
    tracks, floor, said, classified = judge(run, parameters)
    return TimeSpent(
        robots=_robots(tracks, classified),
        blockings=blockings.events(tracks, classified, parameters),
        diagnosis=diagnosis.score(tracks, said, classified),
        decisions=decisions.events(tracks, said, classified, parameters),
        decisions_left_out=sum(one.left_out for one in said.values()),
        findings=findings(tracks, FrameCounts(run.sent, run.heard), floor.passages, parameters),
        deadlocks=blockings.deadlocks(tracks, classified, parameters),
        blames=_blames(tracks, classified),
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


def _blames(tracks: Tracks, classified: Classified) -> tuple[Blame, ...]:
    """In s, from whole µs."""
    waits = (classified.before != NOBODY) & (classified.root != NOBODY)
    pairs = np.column_stack([classified.root[waits], classified.causes[waits]])
    kinds, counts = np.unique(pairs, axis=0, return_counts=True)
    return tuple(
        Blame(tracks.robots[root], CAUSES[cause].value, in_seconds(count * tracks.step_us))
        for (root, cause), count in zip(kinds.tolist(), counts.tolist(), strict=True)
    )
