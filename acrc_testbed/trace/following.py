"""Traces of robots of a run that goes on, each made in a process of its own, which follows its recording."""

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from io import FileIO
from pathlib import Path
from typing import Final, Self

from acrc_testbed.recordings.topics import is_closed
from acrc_testbed.replay.run_recordings import recordings
from acrc_testbed.replay.sandboxed import Call, failed, program_words, start
from acrc_testbed.trace.rows import Trace
from acrc_testbed.trace.traces import PART, Traced, TraceError, decode, inputs, keep, may_keep, parts
from actors.processes.launch import Child, Launcher, launcher, scratch_folder
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError

_PROGRAM: Final = "acrc_testbed.trace.program"
_MOST_BYTES: Final = 64 * 1024 * 1024
"""Of one part; half a second of computing gives less than a tenth of it."""


class Followed:
    """Processes that trace robots; a context manager that ends them.

    What they tell lies in files until it is fetched, so nobody waits for anybody.
    """

    def __init__(self, out: Path, *, permit: Permit, isolate: bool) -> None:
        """`isolate`: in sandboxes."""
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

    def follow(self, actors: Sequence[str]) -> Iterator[Traced]:
        """Begin with those that are not followed yet; why one cannot be."""
        for actor in actors:
            if actor in self._robots:
                continue
            try:
                call = Call(actor, (actor,), ("--follow",))
                words = program_words(self._out, call, permit=self._permit, isolate=self._isolate)
                if self._launched is None:
                    self._launched = self._stack.enter_context(launcher("forkserver"))
                child = start(self._launched, _PROGRAM, self._home, call, words)
                self._robots[actor] = _Followed(self._home / actor / "answer", child)
            except AcrcError as error:
                self._robots[actor] = None
                yield Traced(actor, fault=str(error))

    def poll(self) -> Iterator[Traced]:
        """What they have told since the last call. The last of one may have a fault."""
        if self._launched is None:
            return
        self._launched.wait(0.0)
        for actor in self.going:
            followed = self._robots[actor]
            assert followed is not None
            code = followed.child.exit_code
            try:
                for part in followed.parts():
                    yield Traced(actor, (part,))
                fault = None if code in (None, 0) else failed(followed.child)
            except (TraceError, OSError) as error:
                fault, code = f"{actor}: {error}", 1
            if code is not None:
                self._robots[actor] = None
                if code == 0:
                    self._keep(actor, followed)
                followed.end()
            if fault is not None:
                yield Traced(actor, fault=fault)

    def _keep(self, actor: str, followed: "_Followed") -> None:
        """Keep the trace of a recording that was closed, for who looks at the run afterwards."""
        path = recordings(self._out)[actor]
        if followed.is_sound and is_closed(path) and may_keep(self._out, actor, self._permit):
            with suppress(OSError, TraceError):
                keep(path, inputs(path), parts(followed.answer.read_bytes()))


class _Followed:
    """One robot's process, and how far its answer has been read."""

    def __init__(self, answer: Path, child: Child) -> None:
        self.child = child
        self.answer = answer
        self.is_sound = True
        """Its last part has no fault."""
        self._file: FileIO | None = None
        self._at = 0

    def parts(self) -> Iterator[Trace]:
        """What it has told since the last call. Raises TraceError for what makes no sense."""
        if self._file is None:
            if not self.answer.is_file():
                return
            self._file = FileIO(self.answer)
        while True:
            head = os.pread(self._file.fileno(), PART.size, self._at)
            if len(head) < PART.size:
                return
            (length,) = PART.unpack(head)
            if length > _MOST_BYTES:
                raise TraceError(
                    f"a part of its trace would have {length} bytes; it may have at most {_MOST_BYTES}"
                )
            data = os.pread(self._file.fileno(), length, self._at + PART.size)
            if len(data) < length:
                return
            self._at += PART.size + length
            part = decode(data)
            self.is_sound = part.fault is None
            yield part

    def end(self) -> None:
        """End the process, wherever it is."""
        self.child.send(signal.SIGKILL)
        if self._file is not None:
            self._file.close()
