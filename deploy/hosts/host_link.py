"""Link to one host of a run, used on the computer that started the run."""

import math
import signal
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

import msgspec
from distributed import Future

from acrc_testbed.results.seal import HostLoad
from actors.processes.launcher import ChildProcess, LaunchError, Program, write_setup
from actors.processes.monitor import UNREACHABLE
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.process_table import ProcessState
from deploy.hosts.agent import (
    HostEvents,
    HostOrders,
    HostRecording,
    HostReport,
    ProcessList,
    ProcessStatus,
    StartRobot,
)
from deploy.hosts.connection import error_line
from deploy.hosts.files import FilePart, FilePartError, IncomingFiles, read_files

UNKNOWN_AFTER_S: Final = 3.0
"""Age of a report after which the states of a host's processes are unknown, s."""
_POLL_S: Final = 0.05
_LIST_INTERVAL_S: Final = 1.0
_MAX_REPORT_BYTES: Final = 1 << 23
"""Maximum size of a report: files and states of some ten thousand processes, bytes."""
_PARTS_PER_CALL: Final = 16
"""Maximum number of file parts per call."""
PID_OFFSET: Final = 1 << 32
"""Offset of process ids, times the host's index from 1 on; ids of this computer are below it."""


@dataclass(kw_only=True)
class RemoteChild(ChildProcess):
    """A robot's process on a host."""

    link: "HostLink"
    number: int
    ending: bool = False
    """True if it has exited with output still to be received."""
    left: HostRecording | None = None
    """Its recording, if left on the host."""

    @property
    def host(self) -> str:
        """Name of the host."""
        return self.link.name

    def notes(self) -> Mapping[str, str]:
        """Return the notes of its recording; if that is left on the host, only after the exit."""
        return super().notes() if self.left is None else self.left.notes

    def send(self, number: signal.Signals) -> None:
        """Request that the host sends a signal to the process."""
        if self.exit_code is None and not self.ending:
            self.link.signals.append((self.number, int(number)))


class HostLink:
    """Client of a host's agent: one call at a time, and the state from its reports."""

    def __init__(
        self, name: str, index: int, robots: tuple[str, ...], files: IncomingFiles, agent_future: Future[Any]
    ) -> None:
        """`index`: among the hosts, from 1 on. `files`: writer of its files. `agent_future`: of its agent."""
        self.name, self.robots = name, robots
        self.begun = self.joined = self.done = self.finish = False
        """Inputs are sent; its router is connected; all output is received; no more starts will follow."""
        self.folder = ""
        """Folder of the run there."""
        self.clock_off_s = 0.0
        """Offset of its clock, s; positive: ahead."""
        self.lost = ""
        """Why the host is lost; empty if it is not."""
        self.fault = ""
        """Why the run cannot continue, as reported by the host; empty if it can."""
        self.link_lost_s = math.inf
        """Time of the report that its router lost its connection, on this computer's monotonic clock, s."""
        self.queued: dict[int, float | None] = {}
        """Time that its processes have waited for a processor, s, by process id."""
        self.signals: list[tuple[int, int]] = []
        """Signals to be sent: process number, signal."""
        self.meter = LoadMeter()
        self._index, self._files, self._agent_future = index, files, agent_future
        self._agent: Any = None
        self._input_files: Iterator[FilePart] | None = None
        """Files that are sent before the run."""
        self._call: Any = None
        self._starts: list[StartRobot] = []
        self._children: dict[int, RemoteChild] = {}
        self._process_list = ProcessList()
        self._answered_s = self._progress_s = time.monotonic()
        self._called_s = self._list_requested_s = 0.0
        self._has_more = self._is_closed = False

    @property
    def is_created(self) -> bool:
        """True if its agent has been created."""
        return self._agent is not None

    @property
    def silent_s(self) -> float:
        """Time since the last answer, s."""
        return time.monotonic() - self._answered_s

    @property
    def idle_s(self) -> float:
        """Time since the last progress (received output, accepted files), s."""
        return time.monotonic() - self._progress_s

    @property
    def left(self) -> dict[Path, HostRecording]:
        """Recordings left there, by path here."""
        children = self._children.values()
        return {one.program.record: one.left for one in children if one.left and one.program.record}

    @property
    def ending(self) -> bool:
        """True if output of exited processes is still to be received."""
        return not self.lost and any(one.ending and one.exit_code is None for one in self._children.values())

    def begin(self, files: Iterable[tuple[Path, str]]) -> None:
        """Send these files, with their names there, then start the host's router."""
        self._input_files = read_files(files)

    def start(self, program: Program) -> ChildProcess:
        """Request the start of a robot's process; on a lost host it counts as killed at once."""
        assert program.setup is not None
        write_setup(program)
        number = len(self._children)
        child = RemoteChild(program, self._pid((1 << 31) - 1 - number), link=self, number=number)
        self._children[number] = child
        self._starts.append(StartRobot(number, program.actor, typed_json.dump(program.setup)))
        if self.lost or self.done:
            child.exit_code = -signal.SIGKILL
        return child

    def poll(self) -> None:
        """Process the answer to the last call, if received; make the next call if due.

        Raises LaunchError if files cannot be written here.
        """
        if self.is_over:
            return
        try:
            if self._call is not None and self._call.done():
                call, self._call = self._call, None
                self._process_answer(call.result())
            if self._call is None and not self.is_over:
                self._call_next()
        except FilePartError as error:
            self.mark_lost(f"it has sent {error}")
        except msgspec.MsgspecError as error:
            self.mark_lost(f"it has sent an invalid report: {error}")
        except LaunchError:
            raise
        except Exception as error:  # raised there, or by the library about a lost worker or scheduler
            self.mark_lost(self._failure_reason(error))

    @property
    def is_over(self) -> bool:
        """True if the host is lost or closed."""
        return bool(self.lost) or self._is_closed

    def table(self) -> Iterator[tuple[int, ProcessState]]:
        """Yield its processes with ids unique on this computer; UNREACHABLE without recent reports."""
        is_unknown = self.silent_s > UNKNOWN_AFTER_S or bool(self.lost)
        numbers = self._process_list.numbers
        known = {*numbers.values()}
        for number, child in self._children.items():
            if child.exit_code is None:
                seen = number in known and not (is_unknown or child.ending)
                yield child.pid, ProcessState(0, 0, "S" if seen else UNREACHABLE, 0.0)
        roots = {
            pid: self._children[number].pid for pid, number in numbers.items() if number in self._children
        }
        for one in self._process_list.processes:
            parent = roots.get(one.pid, self._pid(one.parent))
            state = UNREACHABLE if is_unknown else one.state
            yield self._pid(one.pid), ProcessState(parent, self._pid(one.session), state, one.cpu_s)

    def mark_lost(self, reason: str) -> None:
        """Treat the host as lost and its processes as killed."""
        self.lost = self.lost or reason
        self._end_all()

    def _end_all(self) -> None:
        for child in self._children.values():
            if child.exit_code is None:
                child.exit_code = -signal.SIGKILL

    def _pid(self, pid: int) -> int:
        return self._index * PID_OFFSET + pid

    def _failure_reason(self, error: Exception) -> str:
        """Describe why a call failed. The library raises OSError or RuntimeError for a lost worker."""
        if self._agent_future.status == "cancelled":
            return "the connection to the scheduler broke"
        if self._agent is not None and isinstance(error, OSError | RuntimeError):
            return "its worker has ended, or left the cluster"
        return error_line(error)

    def _call_next(self) -> None:
        if self._agent is None:
            if not self._agent_future.done():
                return
            self._agent = self._agent_future.result()
            self._note_progress()
        if self._agent_future.status != "finished":
            raise RuntimeError(self._agent_future.status)
        now = time.monotonic()
        if self.done:
            self._call = self._agent.close()
        elif self._input_files is not None:
            parts = list(islice(self._input_files, _PARTS_PER_CALL))
            self._call = self._agent.put(parts)
            if not parts:
                self.begun, self._input_files = True, None
        elif self._has_more or self._starts or self.signals or now >= self._called_s + _POLL_S:
            list_processes = now >= self._list_requested_s + _LIST_INTERVAL_S
            if list_processes:
                self._list_requested_s = now
                self.meter.note_request()
            orders = HostOrders(tuple(self._starts), tuple(self.signals), list_processes, self.finish)
            self._starts, self.signals, self._called_s = [], [], now
            self._call = self._agent.exchange(orders)

    def _note_progress(self) -> None:
        self._answered_s = self._progress_s = time.monotonic()

    def _process_answer(self, answer: object) -> None:
        if answer is None:  # of `put` and `close`
            self._note_progress()
            self._is_closed = self.done
            return
        if not isinstance(answer, bytes) or len(answer) > _MAX_REPORT_BYTES:
            raise AcrcError("it has sent an answer that is not a report")
        report = msgspec.msgpack.decode(answer, type=HostReport)
        self._answered_s = time.monotonic()
        events = report.events
        if events.files or events.ended or events.ending:
            self._note_progress()
        for part in events.files:
            try:
                self._files.append(part)
            except OSError as error:
                raise LaunchError(f"{part.path} of host {self.name}: {error.strerror}") from error
        if report.joined and not self.joined:
            self.joined, self.folder = True, report.folder
            self.clock_off_s = report.clock_s - time.time()
        if report.is_link_lost:
            self.link_lost_s = min(self.link_lost_s, time.monotonic())
        self._process_events(events)
        if report.process_list is not None:
            self._process_list = report.process_list
            self.meter.add_report(report.process_list.processes)
            self.queued = {self._pid(one.pid): one.queued_s for one in report.process_list.processes}
        self.fault = self.fault or report.fault
        self._has_more, self.done = events.more, report.done
        if self.done:
            self._end_all()

    def _process_events(self, events: HostEvents) -> None:
        numbers_reported = (*events.ending, *events.refused, *(one.number for one in events.ended))
        if unknown := set(numbers_reported) - set(self._children):
            raise AcrcError(f"it reports process {min(unknown)}, which was not requested")
        for number in events.ending:
            self._children[number].ending = True
        for number, reason in events.refused.items():
            child = self._children[number]
            self.fault = self.fault or f"{child.program.actor} cannot be started: {reason}"
            child.exit_code = 1
        for one in events.ended:
            child = self._children[one.number]
            child.left, child.orphans, child.cpu_s = one.left, one.orphans, one.cpu_s
            child.exit_code = one.code


class LoadMeter:
    """Load of a host and response time of its agent, from reports."""

    def __init__(self) -> None:
        self._requested_s = self._reported_s = math.nan
        self._before: dict[int, ProcessStatus] = {}
        self._watched_s = self._worked_s = self._waited_s = 0.0
        self._answers, self._answer_s, self._slowest_s = 0, 0.0, 0.0

    def note_request(self) -> None:
        """Note that a report was requested now."""
        self._requested_s = time.monotonic()

    def add_report(self, processes: Sequence[ProcessStatus]) -> None:
        """Add the processes of a report received now."""
        now = time.monotonic()
        if not math.isnan(self._requested_s):
            self._answers += 1
            self._answer_s += now - self._requested_s
            self._slowest_s = max(self._slowest_s, now - self._requested_s)
            self._requested_s = math.nan
        both = [(self._before[one.pid], one) for one in processes if one.pid in self._before]
        if both:
            self._watched_s += now - self._reported_s
            self._worked_s += math.fsum(max(one.cpu_s - before.cpu_s, 0.0) for before, one in both)
            self._waited_s += math.fsum(_waited_s(before, one) for before, one in both)
        self._before, self._reported_s = {one.pid: one for one in processes}, now

    @property
    def load(self) -> HostLoad:
        """Load so far."""
        watched_s, answers = self._watched_s or math.inf, self._answers or 1
        return HostLoad(
            worked=round(self._worked_s / watched_s, 3),
            waited=round(self._waited_s / watched_s, 3),
            answer_s=round(self._answer_s / answers, 4),
            slowest_s=round(self._slowest_s, 4),
        )


def _waited_s(before: ProcessStatus, now: ProcessStatus) -> float:
    if before.queued_s is None or now.queued_s is None:
        return 0.0
    return max(now.queued_s - before.queued_s, 0.0)
