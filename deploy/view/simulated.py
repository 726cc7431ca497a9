"""The story of a run in the simulated world."""

from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.runtime.process import RunNote
from actors.runtime.recording import decoded, read_notes
from deploy.evidence.run_evidence import RunEvidence, read_run
from deploy.replay.run_recordings import recordings
from deploy.view.story import Floats, Source, Story, Track


class _Identity(msgspec.Struct, frozen=True):
    """What a robot's first record says of it."""

    address: int


def simulated_story(out: Path) -> Story:
    """Read a run's folder, finished, cut or still going on. Raises RecordingError or EvidenceError."""
    run, files = read_run(out), recordings(out)
    actors = [actor for actor, path in files.items() if path.parent.name in run.robots]
    ended = "" if run.result is not None else f", up to {run.end:g} s: it is going on, or was cut off"
    return Story(
        title=f"{len(run.robots)} robots, seed {run.setup.seed}{ended}",
        out=out,
        grid=run.grid,
        tracks={robot: _track(run, index) for index, robot in enumerate(run.robots)},
        places=_places(run),
        begun_with={body.id: len(body.places) for body in run.setup.robots},
        routes=run.routes,
        reported=run.reported,
        taken_over=run.taken_over,
        given_up=run.given_up,
        heard=_heard(run, {files[actor].parent.name: files[actor] for actor in actors}),
        end=run.end,
        true=True,
        sources=tuple(Source(actor, files[actor].parent.name, _seconds) for actor in actors),
    )


def _places(run: RunEvidence) -> dict[str, tuple[tuple[float, float], ...]]:
    """Of each robot, as far as the referee, or else the scenario, names them."""
    found: dict[str, list[tuple[float, float]]] = {robot: [] for robot in run.robots}
    for place in sorted(run.places, key=lambda one: one.place):
        found[place.owner].append((place.x, place.y))
    return {robot: tuple(points) for robot, points in found.items()}


def _seconds(instants: NDArray[np.int64]) -> Floats:
    seconds: Floats = instants / 1e6
    return seconds


def _track(run: RunEvidence, index: int) -> Track:
    powered, stepping = run.powered[:, index], run.stepping[:, index]
    kind = np.where(powered, np.where(stepping, 0, 1), 2)
    begins = np.concatenate(([0], np.flatnonzero(np.diff(kind)) + 1))
    words = ("", "frozen", "off")
    acts = tuple((float(run.seconds[begin]), words[kind[begin]]) for begin in begins.tolist())
    return Track(run.seconds, run.true[:, index], run.held[:, index], acts)


def _heard(run: RunEvidence, files: dict[str, Path]) -> Floats:
    """All receptions of frames whose sender is known."""
    senders: dict[int, int] = {}
    for robot, path in files.items():
        note = read_notes(path).get("run")
        if note is not None:
            told = decoded(path, "run", note, RunNote)
            senders[msgspec.json.decode(told.scenario, type=_Identity).address] = run.robots.index(robot)
    rows = [
        (one.second, senders[one.sender], run.robots.index(one.receiver), one.rssi_dbm)
        for one in run.receptions
        if one.sender in senders
    ]
    return np.array(sorted(rows), np.float64).reshape(-1, 4)
