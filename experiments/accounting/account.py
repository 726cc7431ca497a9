"""Where the time of a simulated run went, from the folder that it has left."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np

from actors.floor.map_file import load_map
from actors.instant import in_seconds
from actors.robot_model import load_model
from actors.runtime import regular_file
from actors.world.world_setup import WorldSetup
from experiments.accounting import blockings, decisions, diagnosis
from experiments.accounting.classify import CAUSES, Classified, classify
from experiments.accounting.episodes import STANDARD, EpisodeParameters
from experiments.accounting.findings import findings
from experiments.accounting.passage import Passages
from experiments.accounting.said import said_by
from experiments.accounting.time_spent import TimeSpent
from experiments.accounting.tracks import Tracks, TracksError, recorded
from observation.evidence.recorded import outcome
from observation.replay.run_recordings import recordings


def account(out: Path, parameters: EpisodeParameters = STANDARD) -> TimeSpent:
    """Where the time went of the run in the folder `out`.

    Raises TracksError if that holds no simulated run, and RecordingError or OutcomeError if it is damaged.
    """
    setup = _setup(out)
    files = recordings(out)
    tracks = recorded(files, setup.step_us)
    said = {
        robot.id: said_by([path for path in files.values() if path.parent.name == robot.id])
        for robot in setup.robots
    }
    radius = max(_radius(out, robot.id, robot.model) for robot in setup.robots)
    map_file = out / setup.robots[0].id / "map.yaml"
    classified = classify(tracks, said, Passages(load_map(map_file), radius, parameters.neck), parameters)
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


def _setup(out: Path) -> WorldSetup:
    file = out / "world" / "setup.json"
    try:
        return msgspec.json.decode(regular_file.content(file), type=WorldSetup)
    except OSError:
        raise TracksError(
            f"{out}: has no {file.relative_to(out)}; must be a simulated run's folder"
        ) from None
    except (ValueError, RecursionError) as error:
        raise TracksError(f"{file}: is not what a run has written: {error}") from None


def _radius(out: Path, robot: str, model: str) -> float:
    own = out / robot / "model.toml"
    return load_model(str(own) if own.exists() else model, None).footprint.circumradius


def _frames(radio: Path) -> Mapping[str, Mapping[str, int]]:
    return outcome(radio, "frames_by_robot", dict[str, dict[str, int]], "a radio") or {}
