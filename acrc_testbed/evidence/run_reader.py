"""Reads a run in the simulated world from its recordings: whole, cut, or piece by piece as these grow."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.evidence.run_evidence import (
    EvidenceError,
    HeardCopy,
    RunEvidence,
    SaidPlaces,
    places,
    result,
    world_setup,
)
from acrc_testbed.recordings.topics import Growing, Recorded
from acrc_testbed.replay.run_recordings import GivenOrder, recordings, setup_of
from actors.floor.map_file import load_map
from actors.instant import in_seconds
from actors.message_limits import OrderLimits, fault
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    RECEIVED,
    SENSES,
    TRUTH,
    Control,
    Drive,
    Heard,
    Received,
    Senses,
    Truth,
)
from actors.radio.radio_model import RadioSetup
from actors.topic import Topic

_PATIENCE_S: Final = 1.0
"""So long what robots recorded of a step is waited for, s."""


class RunReader:
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
        self._index = {robot: index for index, robot in enumerate(self.robots)}
        self._said = SaidPlaces({body.id: len(body.places) for body in self.setup.robots}, self.setup.step_us)
        self._left = np.array([self._said.left(robot) for robot in self.robots], np.int64)
        self._truths: list[Truth] = []
        self._drives: list[tuple[str, Drive]] = []
        self._heard: list[tuple[int, HeardCopy]] = []
        """What no piece has told of yet, with the step in which the robot took it."""
        told = setup_of(files["radio"], RadioSetup, "a radio").robots
        self._addresses = {address: robot for robot, address in told}
        self._given: dict[str, tuple[tuple[float, float], ...]] = {}
        self._told: dict[str, int] = {}
        """By robot the last step of which it has taken down what it sensed."""
        step_us = self.setup.step_us
        self._orders = [
            GivenOrder(one.step(step_us), one.order)
            for one in self.setup.events
            if fault(one.order, OrderLimits()) is None
        ]
        """Those of the scenario and those from outside of which no piece has told yet, but for those whose
        numbers the world refused: a folder of somebody else's may hold anything."""
        self._boundary = 0
        """The step at which the world takes the next order from outside."""
        self._closed = -1
        """The last step that the world has closed."""
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
        self._take("radio", "", self._opened("radio", recordings(self.out)["radio"]))
        return len(self._truths)

    def recorded_s(self, actor: str) -> float:
        """Until when there is a recording of the actor that has been read, s."""
        step = self._files[actor].reading.step
        return in_seconds((step or 0) * self.setup.step_us)

    def beginning(self) -> RunEvidence:
        """The run before its first step."""
        return self._piece([], last=False)

    def poll(self, *, last: bool = False) -> RunEvidence | None:
        """What has come since the last call; None: nothing. `last`: nothing will follow, so all of it.

        Raises RecordingError for damaged files, EvidenceError where the robots change.
        """
        for actor, path in recordings(self.out).items():
            self._take(actor, path.parent.name, self._opened(actor, path))
        until = self._truths[-1].step if last and self._truths else self._complete()
        now = [truth for truth in self._truths if truth.step <= until]
        if self._over or not (now or last):
            return None
        self._over = last
        self._truths = [truth for truth in self._truths if truth.step > until]
        return self._piece(now, last=last)

    def _opened(self, actor: str, path: Path) -> Growing:
        if actor not in self._files:
            self._files[actor] = self._stack.enter_context(Growing(path))
        return self._files[actor]

    def _take(self, actor: str, robot: str, growing: Growing) -> None:
        for one in growing.poll():
            if actor == "radio":
                if _is(one, TRUTH):
                    self._true(_as(one, Truth))
            elif actor == "world":
                if one.key == TRUTH.pattern:
                    self._closed = max(self._closed, one.step - 1)
                elif _is(one, DRIVE):
                    self._drives.append((_robot(one.key, DRIVE), _as(one, Drive)))
                elif _is(one, AIRED):
                    self._boundary = one.step + 1
                elif _is(one, CONTROL):
                    told = _as(one, Control)
                    made = (order for order in told.orders if fault(order, OrderLimits()) is None)
                    self._orders += [GivenOrder(self._boundary, order) for order in made]
            elif robot in self._index:
                self._told_by(robot, one)

    def _true(self, truth: Truth) -> None:
        if truth.halt or not truth.robots:
            return
        if tuple(robot.id for robot in truth.robots) != self.robots:
            raise EvidenceError(
                f"{self._files['radio'].reading.path}: its robots change; they should be the same in all "
                "steps"
            )
        self._truths.append(truth)

    def _told_by(self, robot: str, one: Recorded) -> None:
        if _is(one, SENSES):
            senses = _as(one, Senses)
            self._told[robot] = senses.step
            if senses.places:
                self._given[robot] = (*self._given.get(robot, ()), *senses.places)
        elif _is(one, RECEIVED):
            received = _as(one, Received)
            for event in received.events:
                if isinstance(event, Heard):
                    copy = HeardCopy(in_seconds(event.instant), event.sender, robot, event.rssi_dbm)
                    self._heard.append((received.step, copy))
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

    def _piece(self, truths: Sequence[Truth], *, last: bool) -> RunEvidence:
        seconds = np.array([in_seconds(truth.instant) for truth in truths], np.float64)
        if truths:
            self.step, self._moved = truths[-1].step, time.monotonic()
        end = float(seconds[-1]) if truths else self._since
        end += in_seconds(self.setup.step_us) if last else 0.0
        shape = (len(truths), len(self.robots))
        said = self._words(truths, shape)
        receptions, heard = self._hear(truths, shape, last=last)
        poses = [[(one.x, one.y, one.heading) for one in truth.robots] for truth in truths]
        piece = RunEvidence(
            out=self.out,
            setup=self.setup,
            grid=self.grid,
            robots=self.robots,
            since=self._since,
            end=end,
            seconds=seconds,
            true=np.array(poses, np.float64).reshape(*shape, 3),
            powered=_flags([one.powered for truth in truths for one in truth.robots], shape),
            stepping=_flags([one.stepping for truth in truths for one in truth.robots], shape),
            heard=heard,
            reported=tuple(self._said.reported),
            taken_over=tuple(self._said.taken_over),
            given_up=tuple(self._said.given_up),
            routes=tuple(self._said.routes),
            receptions=receptions,
            jams=tuple((in_seconds(truth.instant), jam) for truth in truths for jam in truth.jams),
            given=dict(self._given),
            orders=self._ordered(),
            addresses=self._addresses,
            processes={
                actor: growing.reading.path.parent.name
                for actor, growing in self._files.items()
                if growing.run is not None and growing.reading.path.parent.name in self._index
            },
            **said,
        )
        self._said.forget()
        self._since = end
        return piece

    def _ordered(self) -> tuple[GivenOrder, ...]:
        """The orders of the steps told of by now; at one boundary the scenario's come first."""
        now = sorted((one for one in self._orders if one.step <= self.step), key=attrgetter("step"))
        self._orders = [one for one in self._orders if one.step > self.step]
        return tuple(now)

    def _words(self, truths: Sequence[Truth], shape: tuple[int, int]) -> dict[str, Any]:
        """What robots said of themselves, step by step; silence means: as before."""
        held, wished = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
        sent = np.zeros(shape, np.int64)
        left = np.broadcast_to(self._left, shape).copy()
        first, until = (truths[0].step, truths[-1].step) if truths else (0, -1)
        for robot, drive in self._drives:
            index = self._index.get(robot)
            if drive.step > until or index is None:
                continue
            self._said.take(robot, drive)
            row = drive.step - first
            if drive.route is not None:
                left[max(row, 0) :, index] = self._left[index] = self._said.left(robot)
            if row >= 0:
                held[row, index] = (np.nan,) * 3 if drive.pose is None else drive.pose
                wished[row, index] = (drive.vx, drive.vy, drive.omega)
                sent[row, index] = drive.transmits
        self._drives = [(robot, drive) for robot, drive in self._drives if drive.step > until]
        return {"held": held, "wished": wished, "sent": sent, "left": left}

    def _hear(
        self, truths: Sequence[Truth], shape: tuple[int, int], *, last: bool
    ) -> tuple[tuple[HeardCopy, ...], NDArray[np.int64]]:
        """The copies of frames that robots took until the last of these steps, and how many in each."""
        counts = np.zeros(shape, np.int64)
        first = truths[0].step if truths else 0
        now = [one for one in self._heard if last or one[0] <= self.step]
        self._heard = [] if last else [one for one in self._heard if one[0] > self.step]
        for step, copy in now:
            if 0 <= step - first < len(counts):
                counts[step - first, self._index[copy.receiver]] += 1
        return tuple(copy for _, copy in now), counts


def recorded_run(out: Path) -> RunEvidence:
    """What the recordings in a run's folder show, as far as they go.

    Raises RecordingError for damaged files, EvidenceError where there is no run in the simulated world.
    """
    with RunReader(out) as reader:
        run = reader.poll(last=True)
    if run is None or not len(run.seconds):
        raise EvidenceError(f"{out}: the run ended before its first step")
    return run


def read_run(out: Path) -> RunEvidence:
    """The same with what became of places, and the result. Raises EvidenceError for a damaged one, too."""
    run = recorded_run(out)
    return replace(run, places=places(run), result=result(out))


def _flags(values: Sequence[bool], shape: tuple[int, int]) -> NDArray[np.bool_]:
    return np.array(values, np.bool_).reshape(shape)


def _is(one: Recorded, topic: Topic[Any]) -> bool:
    return one.direction == "in" and one.topic is topic


def _as(one: Recorded, kind: type[Any]) -> Any:
    message = one.message()
    assert isinstance(message, kind), "who takes a message keeps it in full"
    return message


def _robot(key: str, topic: Topic[Any]) -> str:
    prefix, _, suffix = topic.pattern.partition("{id}")
    return key[len(prefix) : len(key) - len(suffix)]
