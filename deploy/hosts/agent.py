"""Agent of a run on a host (a Dask actor): robot processes, router and files.

The run calls `HostAgent.exchange` about 20 times per second. An agent ends its robots if it is not called for
`HostTask.silence_s`, or is released.
"""

import shutil
import tempfile
import threading
import time
import weakref
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path
from signal import SIGCONT, SIGKILL, SIGTERM, Signals
from typing import Annotated, Any, Final

import msgspec
from distributed import Status, Worker, get_worker
from msgspec import Meta, Struct
from msgspec.structs import replace

from acrc_testbed.results.seal import Id, Sha256, Size
from actors.processes.launcher import ChildProcess, Launcher, Program, create_launcher
from actors.processes.monitor import ResourceMonitor
from actors.robot.program import RobotProgram
from actors.runtime import process_table, regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials, tls
from actors.runtime.isolation.sandbox import FOLDER, ProcessLimits, SandboxPaths, code_paths, own_folder
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import RecordingError, read_notes
from actors.runtime.zenoh_bus import open_host_router
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

Number = Annotated[int, Meta(ge=0, le=1 << 31)]
"""Number of a process, in order of the requests to start it."""
Seconds = Annotated[float, Meta(ge=0)]
Text = Annotated[str, Meta(max_length=2000)]
CODE: Final = "code"
_KEYS: Final = "keys"
_ROUTER_FOLDER: Final = ".router"
"""Folder of the router in the run's folder; not a valid robot id."""
_MAX_INPUT_BYTES: Final = 1 << 30
"""Maximum size of files before the run (maps, models, code), bytes."""
_REPORT_BYTES: Final = 1 << 20
"""Maximum file content per report, bytes: 0.1 s at 100 Mbit/s."""
_POLL_S: Final = 0.05
_GRACE_S: Final = 3.0
_END_NOTES: Final = ("final", "failure")
"""Notes of a process about its end."""


class HostTask(Struct, frozen=True, forbid_unknown_fields=True):
    """One host's part of a run."""

    run: str
    """Random id of the run, for fetching its files later."""
    robots: tuple[Id, ...]
    endpoint: str
    """Endpoint of the world's router."""
    spawn: str
    limits: ProcessLimits
    silence_s: float
    """Timeout between calls, s; afterwards the run is assumed to have ended."""
    code: int
    """Count of the strategy's folders in `code/`."""
    share: tuple[tuple[str, ...], ...]
    """Data shared by the robots' processes, see `deploy.run.plan.shared_arguments`."""
    leave: bool
    """Keep recordings on this host."""


class StartRobot(Struct, frozen=True):
    """Request to start a robot's process."""

    number: Number
    robot: Id
    setup: bytes
    """Content of its set-up file."""


class HostOrders(Struct, frozen=True):
    """Requests of a run to its host, carried out in the order of the fields."""

    start: tuple[StartRobot, ...]
    signals: tuple[tuple[Number, int], ...]
    """Process number and signal number of each signal to send."""
    list_processes: bool
    """Report the states of processes."""
    finish: bool
    """No more processes will be started."""


class EndedProcess(Struct, frozen=True):
    """A process that has exited and whose output has been sent."""

    number: Number
    code: Annotated[int, Meta(ge=-64, le=255)]
    orphans: Annotated[int, Meta(ge=0)]
    cpu_s: Seconds
    left: "HostRecording | None"


class HostRecording(Struct, frozen=True):
    """A recording left on its host."""

    bytes: Size
    sha256: Sha256
    notes: dict[str, Annotated[str, Meta(max_length=1 << 20)]]
    """Notes `final` and `failure` of its process."""


class ProcessStatus(Struct, frozen=True, array_like=True):
    """State of one process on a host, see `process_table`."""

    pid: Number
    parent: Number
    session: Number
    state: Annotated[str, Meta(min_length=1, max_length=1)]
    cpu_s: Seconds
    queued_s: Seconds | None


class ProcessList(Struct, frozen=True):
    """States of the robots' processes and of all their descendants."""

    processes: Annotated[tuple[ProcessStatus, ...], Meta(max_length=100_000)] = ()
    numbers: dict[Number, Number] = {}
    """Numbers of the robots' processes by process id."""


class HostEvents(Struct, frozen=True):
    """Events of a host since the last report."""

    files: tuple[FilePart, ...] = ()
    ending: tuple[Number, ...] = ()
    """Processes that have exited; more of their output follows."""
    refused: dict[Number, Text] = {}
    """Errors of processes that could not be started."""
    ended: tuple[EndedProcess, ...] = ()
    more: bool = False
    """More output is available."""


class HostReport(Struct, frozen=True):
    """Answer of a host agent."""

    clock_s: float
    """Clock of the host, seconds since the epoch."""
    folder: Text
    joined: bool
    """Its router is connected and the world receives its robots' messages."""
    is_link_lost: bool
    """Its router has joined and lost its connection."""
    fault: Text
    """Why the run cannot continue; empty if it can."""
    events: HostEvents
    process_list: ProcessList | None
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


def block_worker(run: str) -> None:
    """Block a thread of the worker while the run has processes here, so that no other task starts."""
    if session := _SESSIONS.get(run):
        session.thread.join()


class _FinishedError(AcrcError):
    """End of the run, or of its calls to this host."""


class _Session:
    """State of an agent; its thread runs until the run has ended here."""

    def __init__(self, task: HostTask, keys: PemKeys, worker: Worker) -> None:
        self._task, self._worker = task, worker
        self._is_started = threading.Event()
        self._folder = Path(tempfile.mkdtemp(prefix=PREFIX)).resolve()
        (self._folder / TASK).write_bytes(msgspec.json.encode(task))
        keys.write(self._folder / _KEYS)
        self._incoming = IncomingFiles(self._folder, {RUN, CODE}.__contains__, _MAX_INPUT_BYTES, "the limit")
        self._lock = threading.Lock()
        """Guards the processes."""
        self._robots = RobotProcesses(self._folder, task)
        self._called_s = time.monotonic()
        self._abandoned = self._finishing = self._joined = self._is_link_lost = False
        self._fault = ""
        self._strategy_file_parts: Iterator[FilePart] | None = None
        self.thread = threading.Thread(target=self._serve, name=f"run {task.run}", daemon=True)
        self.thread.start()

    def put(self, parts: list[FilePart]) -> None:
        """Write files; an empty list begins the run. Raises FilePartError."""
        self._called_s = time.monotonic()
        if not parts:
            self._is_started.set()
        try:
            for part in parts:
                self._incoming.append(part)
        except OSError as error:  # HostLink would take an OSError for a lost worker
            raise AcrcError(f"{self._folder}: files of the run cannot be written: {error.strerror}") from None

    def exchange(self, orders: HostOrders) -> HostReport:
        """Carry out the orders and report."""
        with self._lock:
            self._called_s = time.monotonic()
            self._finishing = self._finishing or orders.finish
            robots = self._robots
            robots.execute(orders)
            rest = self._strategy_files() if not self.thread.is_alive() and robots.is_done else None
            events = robots.events(rest)
            return HostReport(
                clock_s=time.time(),
                folder=str(self._folder),
                joined=self._joined,
                is_link_lost=self._is_link_lost,
                fault=self._fault,
                events=events,
                process_list=robots.process_list() if orders.list_processes else None,
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

    def _strategy_files(self) -> Iterator[FilePart]:
        """Return the iterator, created once, over the files that strategies have written."""
        if self._strategy_file_parts is None:
            run = self._folder / RUN
            folders = (files_below(run / robot / "own", run) for robot in self._task.robots)
            self._strategy_file_parts = read_files(chain.from_iterable(folders))
        return self._strategy_file_parts

    def _serve(self) -> None:
        secrets = self._folder / RUN / _ROUTER_FOLDER / credentials.ROUTER_FILE
        try:
            while not self._is_started.is_set():
                self._poll()
            with create_launcher(self._task.spawn) as launcher:
                self._run(launcher)
        except _FinishedError:
            pass
        except Exception as error:
            kind = "" if isinstance(error, AcrcError) else f"{type(error).__name__}: "
            self._fault = f"{kind}{error}"[:2000]
        finally:
            with self._lock:
                self._robots.close()
            shutil.rmtree(self._folder / _KEYS, ignore_errors=True)
            with suppress(AcrcError):  # a robot has replaced the files
                credentials.remove_router_file(secrets)
            _SESSIONS.pop(self._task.run, None)

    def _run(self, launcher: Launcher) -> None:
        router_credentials = self._write_files(launcher)
        keys = tls.load_keys(self._folder / _KEYS)
        config = tls.host_config(router_credentials, keys, self._task.endpoint)
        with open_host_router(config, self._task.robots[0], between=self._poll) as router:
            try:
                while True:
                    self._poll()
                    if not self._joined and router.joined:
                        credentials.publish_sockets(router_credentials)
                        self._joined = True
                    elif self._joined and not self._is_link_lost:
                        self._is_link_lost = not router.linked
            finally:  # while the router runs, so that robots can exit in order
                self._end_robots()

    def _write_files(self, launcher: Launcher) -> credentials.Credentials:
        """Create the robots' passwords and load shared data.

        The launcher's server removes the passwords even if the worker is killed.
        """
        run = self._folder / RUN
        (run / _ROUTER_FOLDER).mkdir(parents=True)
        for robot in self._task.robots:
            own_folder(run / robot).mkdir(parents=True, exist_ok=True)
        router_credentials = credentials.issue(
            {robot: run / robot for robot in self._task.robots}, run / _ROUTER_FOLDER, ()
        )
        gate = credentials.HostGateway("", self._folder / _KEYS, {})
        credentials.write_router_file(
            run / _ROUTER_FOLDER / credentials.ROUTER_FILE, replace(router_credentials, gate=gate)
        )
        launcher.withdraw(run / _ROUTER_FOLDER / credentials.ROUTER_FILE)
        for words in self._task.share:
            launcher.share("actors.robot.program", words, run)
        self._robots.launcher = launcher
        return router_credentials

    def _poll(self) -> None:
        """Poll the processes, then sleep. Raises _FinishedError at the run's end."""
        silent_s = time.monotonic() - self._called_s
        is_closing = self._worker.status in (Status.closing, Status.closed, Status.failed)
        if self._abandoned or is_closing or silent_s > self._task.silence_s:
            raise _FinishedError
        with self._lock:
            self._robots.poll()
            self._fault = self._fault or self._robots.fault()
            if self._finishing and self._robots.have_all_exited:
                raise _FinishedError
        time.sleep(_POLL_S)

    def _end_robots(self) -> None:
        for number in (SIGTERM, SIGKILL):
            with self._lock:
                self._robots.end(number)
            deadline = time.monotonic() + _GRACE_S
            while not self._robots.have_all_exited and time.monotonic() < deadline:
                with self._lock:
                    self._robots.poll()
                time.sleep(_POLL_S)


class RobotProcesses:
    """Processes of one run on this host, and their output."""

    def __init__(self, folder: Path, task: HostTask) -> None:
        """`folder`: contains the run's folder and, where sandboxes have no access, the code."""
        self._folder, self._task = folder / RUN, task
        self._code = tuple(folder / CODE / str(number) for number in range(1, task.code + 1))
        self.launcher: Launcher | None = None
        """Starts the processes; None: none is started yet."""
        self._closed = False
        self._queued: deque[StartRobot] = deque()
        self._children: dict[int, ChildProcess] = {}
        self._files: dict[Path, GrowingFile] = {}
        self._refused: dict[int, str] = {}
        self._ending: dict[int, ChildProcess] = {}
        """Processes reported as exited with output still to be sent."""
        self._resources = ResourceMonitor(task.limits)

    @property
    def have_all_exited(self) -> bool:
        """True if no process runs or is to be started."""
        return not self._queued and all(child.exit_code is not None for child in self._children.values())

    @property
    def is_done(self) -> bool:
        """True if all processes have exited and their output has been sent."""
        return not (self._queued or self._children or self._refused or self._ending)

    def close(self) -> None:
        """Start no more processes; running ones are killed with their launcher."""
        self._closed = True
        for child in self._running():
            child.exit_code = -SIGKILL

    def execute(self, orders: HostOrders) -> None:
        """Queue the starts, which `poll` executes, and send the signals."""
        if self._closed:
            self._refused |= {order.number: "the run has ended on this host" for order in orders.start}
        else:
            self._queued.extend(orders.start)
        for number, signal in orders.signals:
            if number in self._children:
                self._children[number].send(Signals(signal))

    def poll(self) -> None:
        """Start queued processes if the launcher is ready, and poll for exits."""
        if self.launcher is None:
            return
        self.launcher.wait(0.0)
        while self._queued and self.launcher.ready:
            order = self._queued.popleft()
            try:
                self._children[order.number] = self.launcher.start(self._program(order))
            except (AcrcError, msgspec.MsgspecError) as error:
                self._refused[order.number] = str(error)[:2000]

    def fault(self) -> str:
        """Describe the resource limit that a running process exceeds; empty if there is none."""
        return self._resources.fault(self._running()) or ""

    def end(self, signal: Signals) -> None:
        """Send a signal to every process, then SIGCONT to continue stopped ones."""
        self._queued.clear()
        for child in self._running():
            child.send(signal)
            child.send(SIGCONT)

    def process_list(self) -> ProcessList:
        """Return the states of the processes and their descendants."""
        numbers = {child.pid: number for number, child in self._children.items() if child.exit_code is None}
        table = process_table.processes()
        states = (
            ProcessStatus(pid, one.parent, one.session, one.state, one.cpu_s, process_table.queued_s(pid))
            for pid, one in ((pid, table[pid]) for pid in process_table.descendants(numbers, table))
        )
        return ProcessList(tuple(states), numbers)

    def events(self, strategy_files: Iterator[FilePart] | None) -> HostEvents:
        """Return the events since the last call, with output up to _REPORT_BYTES.

        `strategy_files`: parts to be sent after all other output.
        """
        refused, self._refused = self._refused, {}
        exited = {number: child for number, child in self._children.items() if child.exit_code is not None}
        self._children = {number: one for number, one in self._children.items() if number not in exited}
        self._ending |= exited
        parts: list[FilePart] = []
        ended: list[EndedProcess] = []
        remaining_bytes = _REPORT_BYTES
        for number, child in tuple(self._ending.items()):
            if (remaining_bytes := self._read_output(child.program, parts, remaining_bytes)) <= 0:
                break
            del self._ending[number]
            for path in self._output_files(child.program):
                self._files.pop(path).close()
            left = self._remaining_recording(child.program)
            ended.append(EndedProcess(number, child.exit_code or 0, child.orphans, child.cpu_s, left))
        for child in self._running():
            if remaining_bytes > 0:
                remaining_bytes = self._read_output(child.program, parts, remaining_bytes)
        for part in strategy_files or ():
            parts.append(part)
            if (remaining_bytes := remaining_bytes - len(part.data)) <= 0:
                break
        return HostEvents(tuple(parts), tuple(exited), refused, tuple(ended), remaining_bytes <= 0)

    def _running(self) -> list[ChildProcess]:
        return [child for child in self._children.values() if child.exit_code is None]

    def _program(self, order: StartRobot) -> Program:
        """Return the robot's program with the paths of this computer. Raises AcrcError."""
        program_setup = msgspec.json.decode(order.setup, type=RobotProgram)
        if order.robot not in self._task.robots or program_setup.actor.id != order.robot:
            raise AcrcError(f"{order.robot} is not a robot of this host")
        folder, process = self._folder / order.robot, program_setup.process
        record = folder / Path(process.record).name
        is_isolated = process.isolate
        setup_folder, code = (FOLDER, code_paths(len(self._code))) if is_isolated else (folder, self._code)
        names = SandboxPaths(str(folder), str(record), tuple(map(str, self._code))) if is_isolated else None
        process = msgspec.structs.replace(process, code=tuple(map(str, code)))
        setup: Any = msgspec.structs.replace(program_setup, process=process)
        log = record.with_suffix(".log")
        return Program(order.robot, "actors.robot", (str(setup_folder / SETUP),), log, record, names, setup)

    def _output_files(self, program: Program) -> tuple[Path, ...]:
        assert program.record is not None
        return (program.log,) if self._task.leave else (program.record, program.log)

    def _remaining_recording(self, program: Program) -> HostRecording | None:
        if not self._task.leave or program.record is None:
            return None
        try:
            size, digest = regular_file.size_and_sha256(program.record)
        except OSError:
            return None
        notes: dict[str, str] = {}
        with suppress(RecordingError):  # truncated, as after a full disk
            notes = {name: text for name, text in read_notes(program.record).items() if name in _END_NOTES}
        return HostRecording(size, digest, notes)

    def _read_output(self, program: Program, parts: list[FilePart], remaining_bytes: int) -> int:
        """Append new output of a process to `parts`; return the remaining number of bytes."""
        for path in self._output_files(program):
            name = path.relative_to(self._folder).as_posix()
            file = self._files.setdefault(path, GrowingFile(path, name))
            while remaining_bytes > 0 and (part := file.part()) is not None:
                parts.append(part)
                remaining_bytes -= len(part.data)
        return remaining_bytes
