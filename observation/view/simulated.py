"""The story of a run in the simulated world."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from observation.evidence.run_evidence import RunEvidence
from observation.evidence.run_reader import recorded_run
from observation.evidence.things_over_time import ThingsOverTime, ordered
from observation.recordings.writers import so_far
from observation.view.story import Floats, Source, Story, Track


def simulated_story(out: Path) -> Story:
    """Read a run's folder, finished, cut or still going on. Raises RecordingError or EvidenceError."""
    story = Teller().story(recorded_run(out))
    if (out / "run.json").is_file():
        return story
    return replace(story, title=f"{story.title}, {so_far(out, story.end)}")


class Teller:
    """Makes a story of a run, or of one piece of it after another."""

    def __init__(self) -> None:
        self._acts: dict[str, str] = {}
        self._things = ThingsOverTime()
        self._doors: NDArray[np.bool_] | None = None

    def story(self, run: RunEvidence) -> Story:
        """What there is to draw of it."""
        setup = run.setup
        things = tuple(self._things.extend(run))
        if self._doors is None:
            parts = self._things.floor(run).doorways.regions
            self._doors = parts.labels > parts.count
        return Story(
            title=f"{len(run.robots)} robots, seed {setup.seed}",
            out=run.out,
            grid=run.grid,
            tracks={robot: self._track(run, index) for index, robot in enumerate(run.robots)},
            places={body.id: (*body.places, *run.given.get(body.id, ())) for body in setup.robots},
            begun_with={body.id: len(body.places) for body in setup.robots},
            routes=run.routes,
            reported=run.reported,
            taken_over=run.taken_over,
            given_up=run.given_up,
            heard=_heard(run),
            end=run.end,
            true=True,
            sources=tuple(Source(actor, robot, _seconds) for actor, robot in run.processes.items()),
            since=run.since,
            doors=self._doors,
            things=things,
            ordered=tuple(ordered(run)),
        )

    def _track(self, run: RunEvidence, index: int) -> Track:
        robot, acts = run.robots[index], []
        columns = run.seconds, run.powered[:, index], run.stepping[:, index]
        for second, powered, stepping in zip(*(one.tolist() for one in columns), strict=True):
            state = "off" if not powered else "" if stepping else "frozen"
            if self._acts.get(robot) != state:
                self._acts[robot] = state
                acts.append((second, state))
        return Track(run.seconds, run.true[:, index], run.held[:, index], tuple(acts))


def _heard(run: RunEvidence) -> Floats:
    """(k, 4): all receptions of frames whose sender is known."""
    index = {robot: number for number, robot in enumerate(run.robots)}
    known = [one for one in run.receptions if one.sender in run.addresses]
    rows = [
        (one.second, index[run.addresses[one.sender]], index[one.receiver], one.rssi_dbm) for one in known
    ]
    return np.array(sorted(rows), np.float64).reshape(-1, 4)


def _seconds(instants: NDArray[np.int64]) -> Floats:
    seconds: Floats = instants / 1e6
    return seconds
