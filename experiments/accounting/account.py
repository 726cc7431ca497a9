"""Where the time of a simulated run went, from the folder that it has left."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from actors.floor.map_file import load_map
from actors.instant import in_seconds
from actors.robot_model import load_model
from deploy.evidence.recorded import outcome
from deploy.evidence.run_evidence import world_setup
from deploy.replay.run_recordings import recordings
from experiments.accounting import blockings, decisions, diagnosis
from experiments.accounting.classify import CAUSES, Classified, classify
from experiments.accounting.episodes import STANDARD, EpisodeParameters
from experiments.accounting.findings import findings
from experiments.accounting.passage import Passages
from experiments.accounting.said import said_by
from experiments.accounting.time_spent import TimeSpent
from experiments.accounting.tracks import Tracks, TracksError, recorded


def account(out: Path, parameters: EpisodeParameters = STANDARD) -> TimeSpent:
    """Where the time went of the run in the folder `out`.

    Raises TracksError if that holds no simulated run, and RecordingError or OutcomeError if it is damaged.
    """
    files = recordings(out)
    if "world" not in files:
        raise TracksError(f"{out}: has no recording of the world; must be a simulated run's folder")
    setup = world_setup(files["world"])
    tracks = recorded(files, setup.step_us)
    said = {
        robot.id: said_by([path for path in files.values() if path.parent.name == robot.id])
        for robot in setup.robots
    }
    radius = max(load_model(robot.model).footprint.circumradius for robot in setup.robots)
    classified = classify(tracks, said, Passages(load_map(setup.map), radius, parameters.neck), parameters)
    return TimeSpent(
        robots=_robots(tracks, classified),
        blockings=blockings.events(tracks, classified, parameters),
        diagnosis=diagnosis.score(tracks, said, classified),
        decisions=decisions.events(tracks, said, classified, parameters),
        decisions_left_out=sum(one.left_out for one in said.values()),
        findings=findings(tracks, _frames(files["radio"]), parameters),
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
