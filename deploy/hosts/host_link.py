"""One host, as the computer sees it on which the run was started."""

import math
import select
import signal
import ssl
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from acrc_testbed.results.seal import HostLoad
from actors.processes.launch import Child, LaunchError, Program, write_setup
from actors.processes.silence import OUT_OF_SIGHT
from actors.runtime.lifecycle.process_table import ProcessGlance
from actors.runtime.process_setup import setup_bytes
from deploy.hosts import channel
from deploy.hosts.channel import (
    AskPulse,
    Channel,
    ChannelClosedError,
    Done,
    EndedProcess,
    Fault,
    FilePart,
    FromHost,
    Gone,
    Joined,
    LeftRecording,
    NotStarted,
    Pulse,
    Signal,
    StartRobot,
    ToHost,
    Unlinked,
    listening,
    to_host,
)
from deploy.hosts.fetching import FilePartError, Incoming
from deploy.hosts.host_program import LoadMeter

SUSPICIOUS_S: Final = 3.0
"""After so much silence nobody knows what a host's processes do."""
_LOOK_S: Final = 1.0
_PIDS: Final = 1 << 32
"""A process id on a host and one here are told apart by adding this to the host's, times its place."""


@dataclass(kw_only=True)
class RemoteChild(Child):
    """A robot's process on a host."""

    link: "HostLink"
    number: int
    arriving: bool = False
    """It has ended, and what it has written is on its way."""
    left: LeftRecording | None = None
    """What is known of its recording, if that stays on its host."""

    @property
    def host(self) -> str:
        """Its name."""
        return self.link.name

    def notes(self) -> Mapping[str, str]:
        """What it has noted of itself by now; if its recording stays there, once it has ended."""
        return super().notes() if self.left is None else self.left.notes

    def send(self, number: signal.Signals) -> None:
        """Have its host send a signal; its log is sent here while it grows."""
        if self.exit_code is None and not self.arriving:
            self.link.send(Signal(self.number, int(number)))


class HostLink:
    """The connection to a host, what it has been asked for, and what it says."""

    def __init__(self, name: str, place: int, robots: tuple[str, ...], files: Incoming) -> None:
        """`place`: among the run's hosts, from 1 on. `files`: takes what its robots have written."""
        self.name = name
        self.robots = robots
        self.joined = False
        self.folder = ""
        """Where its robots record there."""
        self.clock_off_s = 0.0
        """By how much its clock is ahead, s."""
        self.done = False
        self.lost = ""
        """Why it is not there any more; empty while it is."""
        self.fault = ""
        """Why the run cannot go on, as it says."""
        self.queued: dict[int, float | None] = {}
        """How long its processes have waited for a processor, by the ids of `table`, s."""
        self.unlinked_s = math.inf
        """Since when its link to the mesh is broken, on this computer's clock, s."""
        self._channel: Channel[FromHost] | None = None
        self._place = place
        self._files = files
        self._children: dict[int, RemoteChild] = {}
        self._pulse = Pulse(processes=(), started={})
        self._heard_s = time.monotonic()
        self._looked_s = 0.0
        self._meter = LoadMeter()

    @property
    def connected(self) -> bool:
        """It has come, though it may be lost by now."""
        return self._channel is not None

    @property
    def silent_s(self) -> float:
        """How long nothing has been heard."""
        return time.monotonic() - self._heard_s

    @property
    def load(self) -> HostLoad:
        """How much it had to do so far."""
        return self._meter.load

    @property
    def left(self) -> dict[Path, LeftRecording]:
        """What is known of the recordings that stay there."""
        children = self._children.values()
        return {one.program.record: one.left for one in children if one.left and one.program.record}

    @property
    def arriving(self) -> bool:
        """What has ended there is still on its way."""
        return not self.lost and any(
            child.arriving and child.exit_code is None for child in self._children.values()
        )

    def connect(self, channel: Channel[FromHost]) -> None:
        """It has come, and has shown its certificate."""
        self._channel = channel
        self._heard_s = time.monotonic()

    def fileno(self) -> int:
        """For `select`."""
        assert self._channel is not None
        return self._channel.fileno()

    @property
    def unsent(self) -> bool:
        """Something waits to be sent."""
        return self._channel is not None and self._channel.waiting > 0

    def send(self, message: ToHost) -> None:
        """Send a message; to one that is lost nothing is sent."""
        if self._channel is not None and not self.lost:
            try:
                self._channel.send(message)
            except ChannelClosedError as error:
                self.lose(str(error))

    def start(self, program: Program) -> Child:
        """Have a robot's process started; if that fails, it ends at once."""
        assert program.setup is not None
        write_setup(program)
        number = len(self._children)
        child = RemoteChild(program, self._pid((1 << 31) - 1 - number), link=self, number=number)
        self._children[number] = child
        self.send(StartRobot(number, program.actor, setup_bytes(program.setup)))
        if self.lost:
            child.exit_code = -signal.SIGKILL
        return child

    def turn(self) -> None:
        """Send and take what there is; ask for a sign of life if it is time."""
        if self._channel is None or self.lost:
            return
        now = time.monotonic()
        try:
            self._channel.flush()
            for message in self._channel.receive():
                self._heard_s = now
                self._take(message)
        except ChannelClosedError as error:
            self.lose(str(error))
        except FilePartError as error:
            self.lose(f"it has sent {error}")
        if now >= self._looked_s + _LOOK_S:
            self._looked_s = now
            if self.joined:
                self._meter.asked()
            self.send(AskPulse())

    def table(self) -> Iterator[tuple[int, ProcessGlance]]:
        """Its processes by ids that nobody here has; out of sight while nothing is heard of it."""
        hidden = self.silent_s > SUSPICIOUS_S or bool(self.lost)
        roots = {}
        started = {*self._pulse.started.values()}
        for number, child in self._children.items():
            if child.exit_code is None:
                seen = number in started and not (hidden or child.arriving)
                state = "S" if seen else OUT_OF_SIGHT
                yield child.pid, ProcessGlance(0, 0, state, 0.0)
        for pid, number in self._pulse.started.items():
            if number in self._children:
                roots[pid] = self._children[number].pid
        for one in self._pulse.processes:
            parent = roots.get(one.pid, self._pid(one.parent))
            state = OUT_OF_SIGHT if hidden else one.state
            yield self._pid(one.pid), ProcessGlance(parent, self._pid(one.session), state, one.cpu_s)

    def over(self, patience_s: float) -> bool:
        """Nothing more will come from it; also if nothing has for so long."""
        return self.done or bool(self.lost) or self.silent_s > patience_s

    def close(self) -> None:
        """Close the connection."""
        if self._channel is not None:
            self._channel.close()

    def _pid(self, pid: int) -> int:
        return self._place * _PIDS + pid

    def lose(self, why: str) -> None:
        """Hold it to be lost, and what runs there to have ended."""
        self.lost = self.lost or why
        for child in self._children.values():
            if child.exit_code is None:
                child.exit_code = -signal.SIGKILL

    def _take(self, message: FromHost) -> None:
        match message:
            case FilePart():
                try:
                    self._files.take(message)
                except OSError as error:
                    raise LaunchError(f"{message.path} of host {self.name}: {error.strerror}") from error
            case Joined():
                self.joined, self.folder = True, message.folder
                self.clock_off_s = message.clock_s - time.time()
            case Unlinked():
                self.unlinked_s = time.monotonic()
            case Pulse():
                self._pulse = message
                if self.joined:
                    self._meter.answered(message.processes)
                self.queued = {self._pid(one.pid): one.queued_s for one in message.processes}
            case Fault():
                self.fault = self.fault or message.why
            case Done():
                self.done = True
            case Gone() | NotStarted() | LeftRecording() | EndedProcess():
                self._end(message)

    def _end(self, message: Gone | NotStarted | LeftRecording | EndedProcess) -> None:
        child = self._children.get(message.number)
        if child is None:
            raise ChannelClosedError(f"it speaks of process {message.number}, which nobody has asked for")
        match message:
            case Gone():
                child.arriving = True
            case NotStarted(why=why):
                self.fault = self.fault or f"{child.program.actor} is not started; {why}"
                child.exit_code = 1
            case LeftRecording():
                child.left = message
            case EndedProcess():
                child.strays, child.cpu_s = message.strays, message.cpu_s
                child.exit_code = message.code


def below(folder: Path, robots: tuple[str, ...], most: int) -> Incoming:
    """Takes what these robots have written into their folders of a run's."""
    return Incoming(folder.resolve(), frozenset(robots).__contains__, most)


_HANDSHAKE_S: Final = 3.0
"""Somebody who comes and says nothing keeps those out so long who come behind."""


class HostReception:
    """Listens until it is closed."""

    def __init__(self, address: str, port: int, keys: Path) -> None:
        """`port`: 0: any. `keys`: folder with this computer's. Raises AcrcError."""
        self._context = channel.server_context(keys)
        self._server = listening(address, port)

    @property
    def port(self) -> int:
        """At which it listens."""
        return int(self._server.getsockname()[1])

    def admit(self, links: Sequence[HostLink], timeout_s: float) -> None:
        """Wait so long for somebody, and connect the link whose host it is, if it is any that is missing."""
        if not select.select([self._server], [], [], timeout_s)[0]:
            return
        plain, _ = self._server.accept()
        plain.settimeout(_HANDSHAKE_S)
        try:
            encrypted: ssl.SSLSocket = self._context.wrap_socket(plain, server_side=True)
        except (OSError, ValueError):
            plain.close()
            return
        name = channel.common_name(encrypted)
        link = next((link for link in links if link.name == name and not link.connected), None)
        if link is None:
            encrypted.close()
        else:
            link.connect(to_host(encrypted))

    def close(self) -> None:
        """Let nobody in any more."""
        self._server.close()
