"""A run in the simulated world, read from its recordings as these grow: piece by piece."""

import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.floor.map_file import load_map
from actors.instant import in_seconds
from actors.messages import DRIVE, RECEIVED, SENSES, TRUTH, Drive, Heard, Received, Senses, Truth
from actors.topic import Topic
from observation.evidence.run_evidence import EvidenceError, world_setup
from observation.evidence.said_places import SaidPlaces
from observation.recordings.topics import Growing, Recorded
from observation.replay.run_recordings import recordings
from observation.view.story import Floats, Source, Story, Track

_PATIENCE_S: Final = 1.0
"""So long what robots recorded of a step is waited for, s."""
_STATES: Final = {(True, True): "", (True, False): "frozen"}
"""By whether a robot's process lives, and takes part; else it is off."""


class _Identity(msgspec.Struct, frozen=True):
    """What a robot's first record says of it."""

    address: int


class GrowingRun:
    """Reads a run's folder, finished, cut or going on; a context manager that closes the files."""

    def __init__(self, out: Path) -> None:
        """RecordingError or EvidenceError where there is no run that has begun, or a damaged one."""
        files = recordings(out)
        for actor in ("world", "radio"):
            if actor not in files:
                raise EvidenceError(
                    f"{out}: there is no recording of the {actor}; it should be the folder of a simulated run"
                )
        self.out, self.setup = out, world_setup(files["world"])
        self.robots = tuple(body.id for body in self.setup.robots)
        self.grid = load_map(self.setup.map)
        self._stack, self._files = ExitStack(), dict[str, Growing]()
        self._said = SaidPlaces({body.id: len(body.places) for body in self.setup.robots}, self.setup.step_us)
        self._truths: list[Truth] = []
        self._drives: list[tuple[str, Drive]] = []
        self._heard: list[tuple[float, int, int, float]] = []
        """Instant, s, address of the sender, index of the receiver, RSSI: what no piece has told of yet."""
        self._senders: dict[int, int] = {}
        self._known: set[str] = set()
        """Recordings of which the first record has been read."""
        self._given: dict[str, tuple[tuple[float, float], ...]] = {}
        self._told: dict[str, int] = {}
        """By robot the last step of which it has taken down what it sensed."""
        self._closed = -1
        """The last step that the world has closed."""
        self._acts: dict[str, str] = {}
        self._since = 0.0
        self._moved = time.monotonic()
        self._over = False
        """The last piece has been given."""
        self.step = -1
        """The last step that a piece has told of."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def behind(self) -> int:
        """Steps that were read, and of which no piece has told yet."""
        return len(self._truths)

    def unread(self) -> int:
        """Steps that were recorded by now, and of which no piece has told; reads what the radio recorded."""
        if "radio" in self._files:
            self._take("radio", "", self._files["radio"])
        return len(self._truths)

    def recorded_s(self, actor: str) -> float:
        """Until when there is a recording of the actor that has been read, s."""
        step = self._files[actor].reading.step
        return in_seconds((step or 0) * self.setup.step_us)

    def beginning(self) -> Story:
        """The run before its first step."""
        return self._piece([], last=False)

    def poll(self, *, last: bool = False) -> Story | None:
        """What has come since the last call; None: nothing. `last`: nothing will follow, so all of it.

        Raises RecordingError for damaged files, EvidenceError where the robots change.
        """
        for actor, path in recordings(self.out).items():
            if actor not in self._files:
                self._files[actor] = self._stack.enter_context(Growing(path))
            self._take(actor, path.parent.name, self._files[actor])
        until = self._truths[-1].step if last and self._truths else self._complete()
        now = [truth for truth in self._truths if truth.step <= until]
        if self._over or not (now or last):
            return None
        self._over = last
        self._truths = [truth for truth in self._truths if truth.step > until]
        return self._piece(now, last=last)

    def _take(self, actor: str, robot: str, growing: Growing) -> None:
        for one in growing.poll():
            if actor == "radio":
                if _is(one, TRUTH, "in"):
                    self._true(one.message())
            elif actor == "world":
                if one.key == TRUTH.pattern:
                    self._closed = max(self._closed, one.step - 1)
                elif _is(one, DRIVE, "in"):
                    self._drives.append((_robot(one.key, DRIVE), _as(one, Drive)))
            elif robot in self.robots:
                self._told_by(robot, one)
        if growing.run is not None and robot in self.robots and actor not in self._known:
            self._known.add(actor)
            identity = msgspec.json.decode(growing.run.setup, type=_Identity)
            self._senders[identity.address] = self.robots.index(robot)

    def _true(self, truth: Any) -> None:
        assert isinstance(truth, Truth)
        if truth.halt or not truth.robots:
            return
        if tuple(robot.id for robot in truth.robots) != self.robots:
            raise EvidenceError(
                f"{self.out / 'radio'}: its robots change; they should be the same in all steps"
            )
        self._truths.append(truth)

    def _told_by(self, robot: str, one: Recorded) -> None:
        if _is(one, SENSES, "in"):
            senses = _as(one, Senses)
            self._told[robot] = senses.step
            if senses.places:
                self._given[robot] = (*self._given.get(robot, ()), *senses.places)
        elif _is(one, RECEIVED, "in"):
            receiver = self.robots.index(robot)
            for event in _as(one, Received).events:
                if isinstance(event, Heard):
                    row = in_seconds(event.instant), event.sender, receiver, event.rssi_dbm
                    self._heard.append(row)
        elif one.key.endswith("/ready"):  # a new process, which is told of all of them once more
            self._given[robot] = ()

    def _complete(self) -> int:
        """The last step of which everything is there that was recorded."""
        if not self._truths:
            return -1
        until = min(self._truths[-1].step, self._closed)
        late = time.monotonic() > self._moved + _PATIENCE_S
        if not late:
            acting = [robot.id for robot in self._truths[-1].robots if robot.stepping]
            until = min([until, *(self._told.get(robot, -1) for robot in acting)])
        return until

    def _piece(self, truths: list[Truth], *, last: bool) -> Story:
        setup = self.setup
        seconds = np.array([in_seconds(truth.instant) for truth in truths], np.float64)
        if truths:
            self.step, self._moved = truths[-1].step, time.monotonic()
        end = float(seconds[-1]) if truths else self._since
        end += in_seconds(setup.step_us) if last else 0.0
        held = self._held(truths)
        places = {body.id: (*body.places, *self._given.get(body.id, ())) for body in setup.robots}
        story = Story(
            title=f"{len(self.robots)} robots, seed {setup.seed}",
            out=self.out,
            grid=self.grid,
            tracks={
                robot: _track(truths, seconds, index, held[:, index], self._acts)
                for index, robot in enumerate(self.robots)
            },
            places=places,
            begun_with={body.id: len(body.places) for body in setup.robots},
            routes=tuple(self._said.routes),
            reported=tuple(self._said.reported),
            taken_over=tuple(self._said.taken_over),
            given_up=tuple(self._said.given_up),
            heard=self._hear(),
            end=end,
            true=True,
            sources=tuple(self._sources()),
            since=self._since,
        )
        self._said.forget()
        self._since = end
        return story

    def _held(self, truths: list[Truth]) -> Floats:
        """(steps, robots, 3): where robots held themselves to be; what they said of places is taken in."""
        held = np.full((len(truths), len(self.robots), 3), np.nan)
        first, until = (truths[0].step, truths[-1].step) if truths else (0, -1)
        for robot, drive in self._drives:
            if drive.step <= until and robot in self.robots:
                self._said.take(robot, drive)
                if drive.pose is not None and drive.step >= first:
                    held[drive.step - first, self.robots.index(robot)] = drive.pose
        self._drives = [(robot, drive) for robot, drive in self._drives if drive.step > until]
        return held

    def _hear(self) -> Floats:
        """(k, 4): all receptions of frames whose sender is known."""
        known = [row for row in self._heard if row[1] in self._senders]
        self._heard = [row for row in self._heard if row[1] not in self._senders]
        rows = sorted((second, self._senders[sender], *more) for second, sender, *more in known)
        return np.array(rows, np.float64).reshape(-1, 4)

    def _sources(self) -> Iterator[Source]:
        for actor, growing in self._files.items():
            robot = growing.reading.path.parent.name
            if robot in self.robots and growing.run is not None:
                yield Source(actor, robot, _seconds)


def _track(
    truths: Iterable[Truth], seconds: Floats, index: int, held: Floats, before: dict[str, str]
) -> Track:
    """What is new of one robot; `before`: whether it acted, which is brought up to date."""
    rows, acts = [], []
    for second, truth in zip(seconds.tolist(), truths, strict=True):
        robot = truth.robots[index]
        rows.append((robot.x, robot.y, robot.heading))
        state = _STATES.get((robot.powered, robot.stepping), "off")
        if before.get(robot.id) != state:
            before[robot.id] = state
            acts.append((second, state))
    return Track(seconds, np.array(rows, np.float64).reshape(-1, 3), held, tuple(acts))


def _seconds(instants: NDArray[np.int64]) -> Floats:
    seconds: Floats = instants / 1e6
    return seconds


def _is(one: Recorded, topic: Topic[Any], direction: str) -> bool:
    return one.direction == direction and one.topic is topic


def _as(one: Recorded, kind: type[Any]) -> Any:
    message = one.message()
    assert isinstance(message, kind), "who takes a message keeps it in full"
    return message


def _robot(key: str, topic: Topic[Any]) -> str:
    prefix, _, suffix = topic.pattern.partition("{id}")
    return key[len(prefix) : len(key) - len(suffix)]
