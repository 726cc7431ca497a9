"""The robots' processes on a host: started as on one computer, and what they write is sent where the run was
started."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from signal import SIGCONT, Signals
from typing import Final

import msgspec

from actors.processes.launch import Child, Launcher, Program
from actors.processes.silence import ResourceWatch
from actors.robot.program import RobotProgram
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import FOLDER, Names, code_places
from actors.runtime.lifecycle import process_table
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import RecordingError, read_notes
from deploy.hosts.channel import (
    Begin,
    Channel,
    EndedProcess,
    Fault,
    FilePart,
    Glimpse,
    Gone,
    LeftRecording,
    NotStarted,
    Pulse,
    Signal,
    StartRobot,
    ToHost,
)
from deploy.hosts.fetching import GrowingFile, parts

_ENDS: Final = ("final", "failure")
"""What a process notes of its end."""
_ENOUGH: Final = 1 << 20
"""Bytes that wait for the connection; more of a file are not read before."""


class HostRobots:
    """All that has been started here for one run."""

    def __init__(
        self, folder: Path, code: Path, begin: Begin, launched: Launcher, channel: Channel[ToHost]
    ) -> None:
        """`folder`: of the run here. `code`: has the folders with the strategy's code, by number from 1 on;
        it lies elsewhere, for of a run's folder robots see nothing but their own part."""
        self._folder = folder
        self._code = code
        self._begin = begin
        self._launched = launched
        self._channel = channel
        self._children: dict[int, Child] = {}
        self._told: set[int] = set()
        """Those whose end has been told."""
        self._files: dict[Path, GrowingFile] = {}
        self._waiting: deque[StartRobot] = deque()
        self._due: deque[tuple[list[GrowingFile], list[LeftRecording | EndedProcess]]] = deque()
        """Of those that have ended: what of their files is to be sent before that is said."""
        self._resources = ResourceWatch(begin.limits)

    @property
    def running(self) -> list[Child]:
        """Processes that have not ended."""
        return [child for child in self._children.values() if child.exit_code is None]

    @property
    def settled(self) -> bool:
        """Everything that is to be said of those that have ended has been."""
        return not (self._due or self._waiting) and len(self._told) == len(self._children)

    def start(self, order: StartRobot) -> None:
        """StartRobot a robot's process as soon as that keeps nobody waiting."""
        self._waiting.append(order)

    def _start(self, order: StartRobot) -> None:
        """With what it is told in terms of this computer."""
        try:
            self._children[order.number] = self._launched.start(self._program(order))
        except (AcrcError, msgspec.MsgspecError) as error:
            self._channel.send(NotStarted(order.number, str(error)[:2000]))

    def signal(self, order: Signal) -> None:
        """Send a process a signal, if it still runs."""
        if order.number in self._children:
            self._children[order.number].send(Signals(order.signal))

    def look(self) -> None:
        """StartRobot who is to be, see who has ended, send of their files what there is room for."""
        if self._waiting and self._launched.ready:
            self._start(self._waiting.popleft())
        for number, child in self._children.items():
            if child.exit_code is not None and number not in self._told:
                self._told.add(number)
                self._channel.send(Gone(number))
                files = [self._growing(path) for path in self._written(child.program)]
                ended = EndedProcess(number, child.exit_code, child.strays, child.cpu_s)
                self._due.append((files, [*self._left(number, child.program), ended]))
        self._send_due()
        programs = [child.program for child in self.running]
        self._send(self._growing(path) for program in programs for path in self._written(program))
        if fault := self._resources.fault(self.running):
            self._channel.send(Fault(fault))

    def pulse(self) -> Pulse:
        """What the processes do."""
        started = {child.pid: number for number, child in self._children.items() if child.exit_code is None}
        known = process_table.table()
        tree = process_table.descendants(started, known)
        seen = tuple(
            Glimpse(pid, one.parent, one.session, one.state, one.cpu_s, process_table.queued_s(pid))
            for pid, one in known.items()
            if pid in tree
        )
        return Pulse(seen, started)

    def own_parts(self) -> Iterable[FilePart]:
        """What robots have written into the part of their folders that is theirs."""
        for robot in self._begin.robots:
            yield from parts(self._folder, self._folder / robot / "own")

    def end(self, number: Signals) -> None:
        """Send all a signal."""
        for child in self.running:
            child.send(number)
            child.send(SIGCONT)

    def _program(self, order: StartRobot) -> Program:
        told = msgspec.json.decode(order.setup, type=RobotProgram)
        if order.robot not in self._begin.robots or told.actor.id != order.robot:
            raise AcrcError(f"{order.robot} is no robot of this host")
        folder, process = self._folder / order.robot, told.process
        record = folder / Path(process.record).name
        folders = [self._code / str(number) for number in range(1, self._begin.code + 1)]
        seen, code = (FOLDER, code_places(len(folders))) if process.isolate else (folder, folders)
        names = Names(str(folder), str(record), tuple(map(str, folders))) if process.isolate else None
        process = msgspec.structs.replace(process, code=tuple(map(str, code)))
        return Program(
            order.robot,
            "actors.robot",
            (str(seen / SETUP),),
            record.with_suffix(".log"),
            record,
            names,
            msgspec.structs.replace(told, process=process),
        )

    def _written(self, program: Program) -> tuple[Path, ...]:
        assert program.record is not None
        return (program.log,) if self._begin.leave else (program.record, program.log)

    def _left(self, number: int, program: Program) -> Iterator[LeftRecording]:
        """What is said of a recording that stays here."""
        record = program.record
        if not self._begin.leave or record is None:
            return
        with suppress(OSError):
            size, digest = regular_file.summed(record)
            noted = {name: said for name, said in _notes(record).items() if name in _ENDS}
            yield LeftRecording(number, size, digest, noted)

    def _growing(self, path: Path) -> GrowingFile:
        return self._files.setdefault(path, GrowingFile(self._folder, path))

    def _send_due(self) -> None:
        while self._due and self._send(self._due[0][0]):
            files, said = self._due.popleft()
            for file in files:
                file.close()
            for message in said:
                self._channel.send(message)

    def _send(self, files: Iterable[GrowingFile]) -> bool:
        """Send what is there of them; False if the connection takes no more for now."""
        for file in files:
            while self._channel.waiting < _ENOUGH:
                part = file.part()
                if part is None:
                    break
                self._channel.send(part)
            else:
                return False
        return True


def _notes(record: Path) -> Mapping[str, str]:
    """Of a process that has ended; empty where that cannot be read, as after a full disk."""
    try:
        return read_notes(record)
    except RecordingError:
        return {}
