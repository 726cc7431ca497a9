"""An actor's process around its shell: join the mesh, publish Ready, run, record the end."""

import ctypes
import gc
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import msgspec
import zenoh

from actors.runtime import failure, typed_json
from actors.runtime.core import Address, Core, Output
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note, in_words, print_traceback
from actors.runtime.linux import Ended, cpu_s
from actors.runtime.prints import Prints, taken_by
from actors.runtime.process_table import has_strays, leftover_fault
from actors.runtime.processor import Processor, processor
from actors.runtime.recording import Recorder
from actors.runtime.shell import ActorDigest, Shell, run_shell
from actors.runtime.typed_json import Count
from actors.runtime.zenoh_bus import ZenohBus, open_session

T = TypeVar("T")


class RunNote(msgspec.Struct, frozen=True):
    """The first record of every file: the process and its set-up."""

    actor: str
    seed: int
    """The run's; a robot's is derived from it (`randomness.derived_seed`)."""
    step_us: int
    commit: str
    setup: msgspec.Raw = msgspec.Raw()
    """The actor's part of its set-up."""
    kernels: dict[str, str] = {}
    """Fingerprint of each numeric kernel on fixed inputs, by module or function."""
    processor: Processor = Processor("")
    """What it ran on."""
    code: dict[str, str] | None = None
    """Sha256 of each module loaded from a folder, by its place there; None: none, or an old recording."""

    def __post_init__(self) -> None:
        """Refuse old recordings, which have a command line, and the set-up as text."""
        if not bytes(self.setup):
            made_by = f"version {self.commit[:60]}" if self.commit else "an earlier version"
            raise ValueError(f"it holds no set-up; {made_by} has made it, and can read it; this one cannot")


class Setup(Protocol):
    """A process's set-up, which can be written as JSON."""

    @property
    def step_us(self) -> int:
        """Length of a step, µs."""


def run_note(
    actor: str,
    setup: Setup,
    commit: str,
    *,
    seed: int = 0,
    kernels: Mapping[str, str] = MappingProxyType({}),
) -> RunNote:
    """Return the first record of a process with this set-up."""
    told = msgspec.Raw(msgspec.json.encode(setup))
    return RunNote(actor, seed, setup.step_us, commit, told, dict(kernels), processor())


class FinalNote(msgspec.Struct, frozen=True):
    """The last record of a process without a failure."""

    digest: ActorDigest
    published: Count
    received: Count
    unread: Count
    """Messages received that the core never took."""
    cpu_s: float
    """From the process's start to its end."""
    startup_cpu_s: float
    """The share of it before the first step."""
    started_s: float
    """Wall clock when the first step began, s since the epoch."""
    ended_s: float
    sent: dict[str, Count] = {}
    """Messages published, by key."""
    arrived: dict[str, Count] = {}
    """Messages received from other actors, by key, taken or not."""
    outcome: dict[str, msgspec.Raw] = {}
    """The actor's results, by subject."""
    code: dict[str, str] = {}
    """As in the first record, with what was loaded later."""

    def report(self, kind: type[T]) -> T:
        """Return the outcome as the struct that the actor made it of. Raises ValueError."""
        return typed_json.decode(msgspec.json.encode(self.outcome), kind)


@dataclass(frozen=True)
class ActorProcess:
    """A core and its connections."""

    core: Core
    listens: Sequence[Address]
    run: RunNote
    ready: Output | None = None
    open_to: Callable[[], Sequence[Address]] = tuple
    bus: Callable[[zenoh.Session, Sequence[Address]], Any] = ZenohBus
    """The bus that `drive` waits on."""
    drive: Callable[[Shell, Any], None] = run_shell
    outcome: Callable[[], Mapping[str, object] | msgspec.Struct] = dict
    code: Callable[[], dict[str, str]] = dict
    """Return the modules loaded so far, as in RunNote."""
    prints: Prints | None = None
    """Takes the output of a strategy; None: there is none."""


def play(
    part: ActorProcess,
    recorder: Recorder,
    config: zenoh.Config,
    on_listening: Callable[[], None] = lambda: None,
    *,
    threads: Collection[threading.Thread] | None = None,
    patience_s: float = 0.0,
) -> int:
    """Run an actor over the mesh; return the exit code: 0 without a failure, 1 with one.

    Closes `recorder`. Calls `on_listening` once all subscriptions are declared. Waits `patience_s` for the
    router. `threads`: those before any code of the user's; others must have ended at the end, and so
    must processes. None: there is no such code.
    """
    with ExitStack() as stack:
        stack.enter_context(recorder)
        recorder.note("run", part.run)
        failure.hold(recorder.path.parent)
        stack.callback(failure.release)
        try:
            session = stack.enter_context(open_session(config, patience_s))
            bus = part.bus(session, part.listens)
            on_listening()
            shell = Shell(part.core, bus, recorder, actor=part.run.actor, open_to=part.open_to)
            shell.prints = part.prints
            if part.ready is not None:
                shell.send(part.ready)
            settle()
            with taken_by(None):  # desks that stand need not be set up each step
                part.drive(shell, bus)
            failure.release()  # to end well takes as much, and a user's code may have left nothing
            if part.prints is not None:
                part.prints.close()
            if threads is not None and (wrong := leftover_fault(has_strays(), threads)):
                raise AcrcError(wrong)
            recorder.note("final", final_note(shell, part, cpu_s()))
        except Ended:
            raise
        except BaseException as error:  # a strategy may call sys.exit, which is no Exception
            failure.release()  # here already: not even a call may be possible
            tell(recorder, part.run.actor, part.core.step, error)
            return 1
    return 0


def tell(recorder: Recorder, actor: str, step: int, error: BaseException) -> None:
    """Report what has ended the process in its last record and in its log, a bug with its traceback."""
    note = failure_note(actor, step, error)
    told = f"{in_words(note)}\n" if note.expected else ""
    try:
        recorder.note("failure", note)
    except AcrcError:  # not even the room that was kept for it is there
        told = f"{in_words(note)}\n"
    if not note.expected:
        print_traceback(error)
    with suppress(OSError):
        sys.stderr.write(told)
        sys.stderr.flush()


def settle() -> None:
    """Return free memory to the system, and exempt all objects from garbage collection."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only
        if trim is not None:
            trim(0)
    gc.freeze()


def final_note(shell: Shell, part: ActorProcess, cpu_s: float) -> FinalNote:
    """Return the last record of a process that has run to its end."""
    report = part.outcome()
    told = msgspec.structs.asdict(report) if isinstance(report, msgspec.Struct) else report
    return FinalNote(
        digest=shell.tally.hash.digest(shell.actor),
        published=shell.tally.published,
        received=shell.tally.received,
        unread=shell.unread,
        cpu_s=cpu_s,
        startup_cpu_s=shell.began.cpu_s,
        started_s=shell.began.wall_s,
        ended_s=time.time(),
        sent=dict(shell.tally.sent),
        arrived=dict(shell.tally.arrived),
        outcome={name: msgspec.Raw(msgspec.json.encode(value)) for name, value in told.items()},
        code=part.code(),
    )
