"""Agent of a run on a host, a Dask actor: robot processes, router and files.

The run calls it about 20 times per second (`HostAgent.exchange`). An agent that is not called for
`HostTask.silence_s`, or is released, ends its robots.
"""

import shutil
import tempfile
import threading
import time
import weakref
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from signal import SIGCONT, SIGKILL, SIGTERM, Signals
from typing import Annotated, Any, Final

import msgspec
from distributed import Status, Worker, get_worker

from acrc_testbed.results.seal import Id, Sha256, Size
from actors.processes.launcher import ChildProcess, Launcher, Program, create_launcher
from actors.processes.monitor import ResourceMonitor
from actors.robot.program import RobotProgram
from actors.runtime import process_table, regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials, tls
from actors.runtime.isolation.credentials import Credentials, HostGateway, publish_sockets
from actors.runtime.isolation.sandbox import FOLDER, ProcessLimits, SandboxPaths, code_paths, own_folder
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import RecordingError, read_notes
from actors.runtime.zenoh_bus import HostRouter, open_host_router
from deploy.hosts.certificates import PemKeys
from deploy.hosts.files import (
    PREFIX,
    RUN,
    TASK,
    FilePart,
    GrowingFile,
    IncomingFiles,
    files_below,
    read_files,
)

Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
"""Number of a process, in order of the requests to start it."""
Seconds = Annotated[float, msgspec.Meta(ge=0)]
Text = Annotated[str, msgspec.Meta(max_length=2000)]
CODE: Final = "code"
_KEYS: Final = "keys"
_INFRA: Final = ".router"
"""Folder of the router in the run's folder; not a valid robot id."""
_MOST_SENT_HERE: Final = 1 << 30
"""Maximum size of files before the run (maps, models, code), bytes."""
_REPORT_BYTES: Final = 1 << 20
"""Maximum file content per report, bytes: 0.1 s at 100 Mbit/s."""
_POLL_S: Final = 0.05
_GRACE_S: Final = 3.0
_ENDS: Final = ("final", "failure")
"""Notes of a process about its end."""


class HostTask(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One host's part of a run."""

    run: str
    """Random id of the run, for fetching its files later."""
    robots: tuple[Id, ...]
    endpoint: str
    """Endpoint of the world's router."""
    spawn: str
    limits: ProcessLimits
    silence_s: float
    """Timeout of calls, s, after which the run is assumed to have ended."""
    code: int
    """Number of the strategy's folders in `code/`."""
    share: tuple[tuple[str, ...], ...]
    """Data shared by the robots' processes, see `deploy.run.plan.shared_arguments`."""
    leave: bool
    """Keep recordings here."""


class StartRobot(msgspec.Struct, frozen=True):
    """Request to start a robot's process."""

    number: Number
    robot: Id
    setup: bytes
    """Content of its set-up file."""


class HostOrders(msgspec.Struct, frozen=True):
    """Requests of a run to its host, in this order."""

    start: tuple[StartRobot, ...] = ()
    signals: tuple[tuple[Number, int], ...] = ()
    """Numbers of process and signal."""
    look: bool = False
    """Report the states of processes."""
    finish: bool = False
    """No more processes will be started."""


class EndedProcess(msgspec.Struct, frozen=True):
    """A process that has exited, after all its output."""

    number: Number
    code: Annotated[int, msgspec.Meta(ge=-64, le=255)]
    orphans: Annotated[int, msgspec.Meta(ge=0)]
    cpu_s: Seconds
    left: "HostRecording | None" = None


class HostRecording(msgspec.Struct, frozen=True):
    """A recording left on its host."""

    bytes: Size
    sha256: Sha256
    notes: dict[str, Annotated[str, msgspec.Meta(max_length=1 << 20)]]
    """Notes of its process: `final`, `failure`."""


class ProcessStatus(msgspec.Struct, frozen=True, array_like=True):
    """State of one process on a host, see `process_table`."""

    pid: Number
    parent: Number
    session: Number
    state: Annotated[str, msgspec.Meta(min_length=1, max_length=1)]
    cpu_s: Seconds
    queued_s: Seconds | None


class ProcessList(msgspec.Struct, frozen=True):
    """States of the robots' processes and of all their descendants."""

    processes: Annotated[tuple[ProcessStatus, ...], msgspec.Meta(max_length=100_000)] = ()
    numbers: dict[Number, Number] = {}
    """Numbers of the robots' processes by process id."""


class HostEvents(msgspec.Struct, frozen=True):
    """Events of a host since the last report."""

    files: tuple[FilePart, ...] = ()
    ending: tuple[Number, ...] = ()
    """Processes that have exited; the rest of their output follows."""
    refused: dict[Number, Text] = {}
    """Errors of processes that could not be started."""
    ended: tuple[EndedProcess, ...] = ()
    more: bool = False
    """More output is available."""


class HostReport(msgspec.Struct, frozen=True):
    """Answer of a host agent."""

    clock_s: float
    """Clock of the host, seconds since the epoch."""
    folder: Text
    joined: bool
    """Its router is connected and the world receives its robots' messages."""
    unlinked: bool
    """Its router has lost its connection afterwards."""
    fault: Text
    """Why the run cannot continue; empty if it can."""
    events: HostEvents
    looked: ProcessList | None
    done: bool
    """All processes have exited and all files have been sent."""


class HostAgent:
    """Dask actor: methods run one after another in a thread of the worker."""

    def __init__(self, task: HostTask, keys: PemKeys) -> None:
        self._session = _SESSIONS[task.run] = _Session(task, keys, get_worker())
        weakref.finalize(self, self._session.abandon)

    def put(self, parts: list[FilePart]) -> None:
        """Write files of the run; an empty list starts the router."""
        self._session.put(parts)

    def exchange(self, orders: HostOrders) -> bytes:
        """Carry out orders and return a HostReport as msgpack."""
        return msgspec.msgpack.encode(self._session.exchange(orders))

    def close(self) -> None:
        """Remove the run's folder, all of which has been sent."""
        self._session.close()


_SESSIONS: Final[dict[str, "_Session"]] = {}


def occupy(run: str) -> None:
    """Block a thread of the worker while the run has processes here, so that other tasks wait."""
    if session := _SESSIONS.get(run):
        session.thread.join()


class _FinishedError(AcrcError):
    """The run has ended or no longer calls this host."""


class _Session:
    """State of an agent; its thread runs until the run has ended here."""

    def __init__(self, task: HostTask, keys: PemKeys, worker: Worker) -> None:
        self._task, self._worker = task, worker
        self._begun = threading.Event()
        self._folder = Path(tempfile.mkdtemp(prefix=PREFIX)).resolve()
        (self._folder / TASK).write_bytes(msgspec.json.encode(task))
        keys.write(self._folder / _KEYS)
        self._incoming = IncomingFiles(self._folder, {RUN, CODE}.__contains__, _MOST_SENT_HERE, "the limit")
        self._lock = threading.Lock()
        """Guards the processes."""
        self._robots = RobotProcesses(self._folder, task)
        self._called_s = time.monotonic()
        self._abandoned = self._finishing = self._joined = self._unlinked = False
        self._fault = ""
        self._own: Iterator[FilePart] | None = None
        self.thread = threading.Thread(target=self._serve, name=f"run {task.run}", daemon=True)
        self.thread.start()

    def put(self, parts: list[FilePart]) -> None:
        """Write files; an empty list begins the run. Raises FilePartError."""
        self._called_s = time.monotonic()
        if not parts:
            self._begun.set()
        try:
            for part in parts:
                self._incoming.take(part)
        except OSError as error:  # the library reports a lost worker as OSError
            raise AcrcError(f"{self._folder}: files of the run cannot be written: {error.strerror}") from None

    def exchange(self, orders: HostOrders) -> HostReport:
        """Carry out the orders and report."""
        with self._lock:
            self._called_s = time.monotonic()
            self._finishing = self._finishing or orders.finish
            robots = self._robots
            robots.order(orders)
            rest = self._rest() if not self.thread.is_alive() and robots.settled else None
            events = robots.events(rest)
            return HostReport(
                clock_s=time.time(),
                folder=str(self._folder),
                joined=self._joined,
                unlinked=self._unlinked,
                fault=self._fault,
                events=events,
                looked=robots.looked() if orders.look else None,
                done=rest is not None and not events.more,
            )

    def abandon(self) -> None:
        """End the robots, because the actor is no longer referenced."""
        self._abandoned = True

    def close(self) -> None:
        """Remove the folder, unless recordings are left here."""
        self._abandoned = True
        self.thread.join(2 * _GRACE_S)
        if not self._task.leave:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _rest(self) -> Iterator[FilePart]:
        """Return one iterator over the files written by strategies."""
        if self._own is None:
            run = self._folder / RUN
            owns = (files_below(run / robot / "own", run) for robot in self._task.robots)
            self._own = read_files(chain.from_iterable(owns))
        return self._own

    def _serve(self) -> None:
        secrets = self._folder / RUN / _INFRA / credentials.ROUTER_FILE
        try:
            while not self._begun.is_set():
                self._turn()
            with create_launcher(self._task.spawn) as launched:
                self._run(launched)
        except _FinishedError:
            pass
        except Exception as error:
            kind = "" if isinstance(error, AcrcError) else f"{type(error).__name__}: "
            self._fault = f"{kind}{error}"[:2000]
        finally:
            with self._lock:
                self._robots.close()
            shutil.rmtree(self._folder / _KEYS, ignore_errors=True)
            with suppress(AcrcError):  # a robot has replaced them
                credentials.remove_router_file(secrets)
            _SESSIONS.pop(self._task.run, None)

    def _run(self, launched: Launcher) -> None:
        issued = self._lay_out(launched)
        keys = tls.load_keys(self._folder / _KEYS)
        config = tls.host_config(issued, keys, self._task.endpoint)
        with open_host_router(config, self._task.robots[0], between=self._turn) as router:
            try:
                while True:
                    self._turn()
                    self._look_at_link(router, issued)
            finally:  # before the router closes, so that robots exit in order
                self._end_robots()

    def _lay_out(self, launched: Launcher) -> Credentials:
        """Create the robots' passwords and load shared data.

        The launcher's server removes the secrets even if the worker is killed.
        """
        run = self._folder / RUN
        (run / _INFRA).mkdir(parents=True)
        for robot in self._task.robots:
            own_folder(run / robot).mkdir(parents=True, exist_ok=True)
        issued = credentials.issue({robot: run / robot for robot in self._task.robots}, run / _INFRA, ())
        gate = HostGateway("", self._folder / _KEYS, {})
        credentials.write_router_file(run / _INFRA / credentials.ROUTER_FILE, replace(issued, gate=gate))
        launched.withdraw(run / _INFRA / credentials.ROUTER_FILE)
        for words in self._task.share:
            launched.share("actors.robot.program", words, run)
        self._robots.open(launched)
        return issued

    def _turn(self) -> None:
        """Check the processes, then sleep. Raises _FinishedError at the run's end."""
        silent_s = time.monotonic() - self._called_s
        leaving = self._worker.status in (Status.closing, Status.closed, Status.failed)
        if self._abandoned or leaving or silent_s > self._task.silence_s:
            raise _FinishedError
        with self._lock:
            self._robots.look()
            self._fault = self._fault or self._robots.fault()
            if self._finishing and self._robots.all_ended:
                raise _FinishedError
        time.sleep(_POLL_S)

    def _look_at_link(self, router: HostRouter, issued: Credentials) -> None:
        if not self._joined and router.joined:
            publish_sockets(issued)
            self._joined = True
        elif self._joined and not self._unlinked:
            self._unlinked = not router.linked

    def _end_robots(self) -> None:
        for number in (SIGTERM, SIGKILL):
            with self._lock:
                self._robots.end(number)
            deadline = time.monotonic() + _GRACE_S
            while not self._robots.all_ended and time.monotonic() < deadline:
                with self._lock:
                    self._robots.look()
                time.sleep(_POLL_S)


class RobotProcesses:
    """Processes of one run on this host, and their output."""

    def __init__(self, folder: Path, task: HostTask) -> None:
        """`folder`: contains the run's folder and, outside the robots' sandboxes, the code."""
        self._folder, self._task = folder / RUN, task
        self._code = tuple(folder / CODE / str(number) for number in range(1, task.code + 1))
        self._launched: Launcher | None = None
        self._closed = False
        self._waiting: deque[StartRobot] = deque()
        self._children: dict[int, ChildProcess] = {}
        self._files: dict[Path, GrowingFile] = {}
        self._refused: dict[int, str] = {}
        self._ending: dict[int, ChildProcess] = {}
        """Processes reported as exited with output still to be sent."""
        self._resources = ResourceMonitor(task.limits)

    @property
    def all_ended(self) -> bool:
        """Whether no process runs or is to be started."""
        return not self._waiting and all(child.exit_code is not None for child in self._children.values())

    @property
    def settled(self) -> bool:
        """Whether all processes have exited and their output has been sent."""
        return not (self._waiting or self._children or self._refused or self._ending)

    def open(self, launched: Launcher) -> None:
        """Start processes with `launched` from now on."""
        self._launched = launched

    def close(self) -> None:
        """Start no more processes; running ones are killed with their launcher."""
        self._closed = True
        for child in self._running():
            child.exit_code = -SIGKILL

    def order(self, orders: HostOrders) -> None:
        """Queue starts until the launcher is ready; send signals."""
        if self._closed:
            self._refused |= {order.number: "the run has ended on this host" for order in orders.start}
        else:
            self._waiting.extend(orders.start)
        for number, signal in orders.signals:
            if number in self._children:
                self._children[number].send(Signals(signal))

    def look(self) -> None:
        """Start queued processes and poll for exits."""
        if self._launched is None:
            return
        self._launched.wait(0.0)
        while self._waiting and self._launched.ready:
            order = self._waiting.popleft()
            try:
                self._children[order.number] = self._launched.start(self._program(order))
            except (AcrcError, msgspec.MsgspecError) as error:
                self._refused[order.number] = str(error)[:2000]

    def fault(self) -> str:
        """Describe the resource limit that a running process exceeds; empty: none."""
        return self._resources.fault(self._running()) or ""

    def end(self, signal: Signals) -> None:
        """Signal every process, including stopped ones."""
        self._waiting.clear()
        for child in self._running():
            child.send(signal)
            child.send(SIGCONT)

    def looked(self) -> ProcessList:
        """Return the states of the processes and their descendants."""
        numbers = {child.pid: number for number, child in self._children.items() if child.exit_code is None}
        table = process_table.processes()
        seen = (
            ProcessStatus(pid, one.parent, one.session, one.state, one.cpu_s, process_table.queued_s(pid))
            for pid, one in ((pid, table[pid]) for pid in process_table.descendants(numbers, table))
        )
        return ProcessList(tuple(seen), numbers)

    def events(self, rest: Iterator[FilePart] | None) -> HostEvents:
        """Return the events since the last call, with output up to _REPORT_BYTES.

        `rest`: files to be sent last.
        """
        refused, self._refused = self._refused, {}
        new = {number: child for number, child in self._children.items() if child.exit_code is not None}
        self._children = {number: one for number, one in self._children.items() if number not in new}
        self._ending |= new
        parts: list[FilePart] = []
        ended: list[EndedProcess] = []
        room = _REPORT_BYTES
        for number, child in tuple(self._ending.items()):
            if (room := self._read(child.program, parts, room)) <= 0:
                break
            del self._ending[number]
            for path in self._written(child.program):
                self._files.pop(path).close()
            left = self._left(child.program)
            ended.append(EndedProcess(number, child.exit_code or 0, child.orphans, child.cpu_s, left))
        for child in self._running():
            if room > 0:
                room = self._read(child.program, parts, room)
        for part in rest or ():
            parts.append(part)
            if (room := room - len(part.data)) <= 0:
                break
        return HostEvents(tuple(parts), tuple(new), refused, tuple(ended), room <= 0)

    def _running(self) -> list[ChildProcess]:
        return [child for child in self._children.values() if child.exit_code is None]

    def _program(self, order: StartRobot) -> Program:
        """Return the program with the paths of this computer."""
        told = msgspec.json.decode(order.setup, type=RobotProgram)
        if order.robot not in self._task.robots or told.actor.id != order.robot:
            raise AcrcError(f"{order.robot} is not a robot of this host")
        folder, process = self._folder / order.robot, told.process
        record = folder / Path(process.record).name
        isolated = process.isolate
        seen, code = (FOLDER, code_paths(len(self._code))) if isolated else (folder, self._code)
        names = SandboxPaths(str(folder), str(record), tuple(map(str, self._code))) if isolated else None
        process = msgspec.structs.replace(process, code=tuple(map(str, code)))
        setup: Any = msgspec.structs.replace(told, process=process)
        log = record.with_suffix(".log")
        return Program(order.robot, "actors.robot", (str(seen / SETUP),), log, record, names, setup)

    def _written(self, program: Program) -> tuple[Path, ...]:
        assert program.record is not None
        return (program.log,) if self._task.leave else (program.record, program.log)

    def _left(self, program: Program) -> HostRecording | None:
        if not self._task.leave or program.record is None:
            return None
        try:
            size, digest = regular_file.size_and_sha256(program.record)
        except OSError:
            return None
        notes: dict[str, str] = {}
        with suppress(RecordingError):  # truncated, as after a full disk
            notes = {name: text for name, text in read_notes(program.record).items() if name in _ENDS}
        return HostRecording(size, digest, notes)

    def _read(self, program: Program, parts: list[FilePart], room: int) -> int:
        """Read new output of a process; return the remaining room, bytes."""
        for path in self._written(program):
            name = path.relative_to(self._folder).as_posix()
            file = self._files.setdefault(path, GrowingFile(path, name))
            while room > 0 and (part := file.part()) is not None:
                parts.append(part)
                room -= len(part.data)
        return room
