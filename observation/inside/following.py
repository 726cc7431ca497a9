"""Robots of a run that goes on, looked into: each in a process of its own, which follows its recording."""

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from io import FileIO
from pathlib import Path
from typing import Final, Self

from actors.processes.launch import Child, Launcher, launcher
from actors.processes.scratch import scratch_folder
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from observation.inside.insides import PERIOD, Glance
from observation.inside.telemetry import PART, Inside, TelemetryError, decode
from observation.replay.shut_off_calls import Call, failed, start, told

_PROGRAM: Final = "observation.inside.following_program"
_MOST_BYTES: Final = 64 * 1024 * 1024
"""Of one part; half a second of computing gives less than a tenth of it."""


class Followed:
    """Processes that look into robots; a context manager that ends them.

    What they tell lies in files until it is fetched, so nobody waits for anybody.
    """

    def __init__(self, out: Path, *, permit: Permit, isolate: bool) -> None:
        """`isolate`: shut the robots' code off."""
        self._out, self._permit, self._isolate = out, permit, isolate
        self._stack = ExitStack()
        self._launched: Launcher | None = None
        self._home = Path()
        self._robots: dict[str, _Followed | None] = {}
        """By actor; None: it is not followed any more."""

    def __enter__(self) -> Self:
        self._home = self._stack.enter_context(scratch_folder())
        return self

    def __exit__(self, *_: object) -> None:
        for followed in self._robots.values():
            if followed is not None:
                followed.end()
        self._stack.close()

    @property
    def going(self) -> tuple[str, ...]:
        """Who is followed."""
        return tuple(actor for actor, followed in self._robots.items() if followed is not None)

    def follow(self, actors: Sequence[str]) -> Iterator[Glance]:
        """Begin with those that are not followed yet; why one cannot be."""
        for actor in actors:
            if actor in self._robots:
                continue
            try:
                call = Call(actor, (actor,), ("--period-us", str(PERIOD)))
                words = told(self._out, call, permit=self._permit, isolate=self._isolate)
                if self._launched is None:
                    self._launched = self._stack.enter_context(launcher("forkserver"))
                child = start(self._launched, _PROGRAM, self._home, call, words)
                self._robots[actor] = _Followed(self._home / actor / "answer", child)
            except AcrcError as error:
                self._robots[actor] = None
                yield Glance(actor, fault=str(error))

    def poll(self) -> Iterator[Glance]:
        """What they have told since the last call. The last glance at one may have a fault."""
        if self._launched is None:
            return
        self._launched.wait(0.0)
        for actor in self.going:
            followed = self._robots[actor]
            assert followed is not None
            code = followed.child.exit_code
            try:
                for inside in followed.parts():
                    yield Glance(actor, inside=inside)
                fault = None if code in (None, 0) else failed(followed.child)
            except (TelemetryError, OSError) as error:
                fault, code = f"{actor}: {error}", 1
            if code is not None:
                self._robots[actor] = None
                followed.end()
            if fault is not None:
                yield Glance(actor, fault=fault)


class _Followed:
    """One robot's process, and how far its answer has been read."""

    def __init__(self, answer: Path, child: Child) -> None:
        self.child = child
        self._answer = answer
        self._file: FileIO | None = None
        self._at = 0

    def parts(self) -> Iterator[Inside]:
        """What it has told since the last call. Raises TelemetryError for what makes no sense."""
        if self._file is None:
            if not self._answer.is_file():
                return
            self._file = FileIO(self._answer)
        while True:
            head = os.pread(self._file.fileno(), PART.size, self._at)
            if len(head) < PART.size:
                return
            (length,) = PART.unpack(head)
            if length > _MOST_BYTES:
                raise TelemetryError(
                    f"a part of its telemetry would have {length} bytes; it may have at most {_MOST_BYTES}"
                )
            data = os.pread(self._file.fileno(), length, self._at + PART.size)
            if len(data) < length:
                return
            self._at += PART.size + length
            yield decode(data)

    def end(self) -> None:
        """End the process, wherever it is."""
        self.child.send(signal.SIGKILL)
        if self._file is not None:
            self._file.close()
