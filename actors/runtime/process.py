"""Process of an actor: join the mesh, publish Ready, run the core, record the outcome."""

import ctypes
import gc
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import msgspec
import zenoh

from actors.runtime import failure, typed_json
from actors.runtime.captured_output import CapturedOutput, captured_by
from actors.runtime.core import Address, Core, Output
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note, failure_sentence, print_traceback
from actors.runtime.linux import Termination, cpu_s
from actors.runtime.process_table import has_descendants, leftover_fault
from actors.runtime.processor import Processor, processor
from actors.runtime.recording import Recorder
from actors.runtime.shell import ActorDigest, Shell, run_shell
from actors.runtime.typed_json import Count
from actors.runtime.zenoh_bus import ZenohBus, open_session

T = TypeVar("T")


class RunNote(msgspec.Struct, frozen=True):
    """First record of every recording: the process and its set-up."""

    actor: str
    seed: int
    """The run's seed; a robot's seed is derived from it (`randomness.derived_seed`)."""
    step_us: int
    commit: str
    setup: msgspec.Raw = msgspec.Raw()
    """The actor's part of the set-up."""
    kernels: dict[str, str] = {}
    """Fingerprint of each numeric kernel on fixed inputs, by module or function."""
    processor: Processor = Processor("")
    """Processor that it ran on."""
    code: dict[str, str] | None = None
    """SHA-256 of each module loaded from a folder, by relative path; None: no such folder, or an old
    recording."""

    def __post_init__(self) -> None:
        """Reject old recordings, which have a command line, and the set-up as text."""
        if not bytes(self.setup):
            made_by = f"version {self.commit[:60]}" if self.commit else "an earlier version"
            raise ValueError(f"it has no set-up; {made_by} recorded it: use that version")


class Setup(Protocol):
    """A process's set-up, serialisable as JSON."""

    @property
    def step_us(self) -> int:
        """Duration of a step, µs."""


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
    """Last record of a process that did not fail."""

    digest: ActorDigest
    published: Count
    received: Count
    unread: Count
    """Messages received and never used by the core."""
    cpu_s: float
    """CPU time of the process, s."""
    startup_cpu_s: float
    """Part of it before the first step."""
    started_s: float
    """Wall-clock time of the first step, s since the epoch."""
    ended_s: float
    sent: dict[str, Count] = {}
    """Number of messages published, by key."""
    arrived: dict[str, Count] = {}
    """Number of messages received from other actors, by key, used or not."""
    outcome: dict[str, msgspec.Raw] = {}
    """Results of the actor, by subject."""
    code: dict[str, str] = {}
    """As in the first record, plus modules loaded later."""

    def report(self, kind: type[T]) -> T:
        """Return the outcome as a struct of type `kind`. Raises ValueError."""
        return typed_json.decode(msgspec.json.encode(self.outcome), kind)


class ActorProcess(msgspec.Struct, frozen=True):
    """A core with its connections."""

    core: Core
    listens: Sequence[Address]
    run: RunNote
    ready: Output | None = None
    optional_inputs: Callable[[], Sequence[Address]] = tuple
    bus: Callable[[zenoh.Session, Sequence[Address]], Any] = ZenohBus
    """Bus that `drive` waits on."""
    drive: Callable[[Shell, Any], None] = run_shell
    outcome: Callable[[], Mapping[str, object] | msgspec.Struct] = dict
    code: Callable[[], dict[str, str]] = dict
    """Return the modules loaded so far, as in RunNote."""
    prints: CapturedOutput | None = None
    """Captures the output of a strategy; None: there is no strategy."""


def run_actor(
    part: ActorProcess,
    recorder: Recorder,
    config: zenoh.Config,
    on_listening: Callable[[], None] = lambda: None,
    *,
    threads: Collection[threading.Thread] | None = None,
    patience_s: float = 0.0,
) -> int:
    """Run an actor over the mesh; return the exit code: 0, or 1 after a failure.

    Closes `recorder`. Calls `on_listening` once all subscriptions are declared. Waits `patience_s` for the
    router. `threads`: threads that exist before user code runs; all others, and child processes, must have
    ended at the end. None: there is no user code.
    """
    with ExitStack() as stack:
        stack.enter_context(recorder)
        recorder.note("run", part.run)
        failure.hold_reserve(recorder.path.parent)
        stack.callback(failure.release_reserve)
        try:
            session = stack.enter_context(open_session(config, patience_s))
            bus = part.bus(session, part.listens)
            on_listening()
            shell = Shell(
                part.core, bus, recorder, actor=part.run.actor, optional_inputs=part.optional_inputs
            )
            shell.prints = part.prints
            if part.ready is not None:
                shell.send(part.ready)
            freeze_heap()
            with captured_by(None):  # replaces the streams once, not in each step
                part.drive(shell, bus)
            failure.release_reserve()  # ending takes resources that user code may have used up
            if part.prints is not None:
                part.prints.close()
            if threads is not None and (wrong := leftover_fault(has_descendants(), threads)):
                raise AcrcError(wrong)
            recorder.note("final", final_note(shell, part, cpu_s()))
        except Termination:
            raise
        except BaseException as error:  # a strategy may call sys.exit, which is not an Exception
            failure.release_reserve()  # first of all: without memory no call may succeed
            report_failure(recorder, part.run.actor, part.core.step, error)
            return 1
    return 0


def report_failure(recorder: Recorder, actor: str, step: int, error: BaseException) -> None:
    """Report a process's failure in its last record and its log; a bug with its traceback."""
    note = failure_note(actor, step, error)
    told = f"{failure_sentence(note)}\n" if note.expected else ""
    try:
        recorder.note("failure", note)
    except AcrcError:  # even the reserved disk space is gone
        told = f"{failure_sentence(note)}\n"
    if not note.expected:
        print_traceback(error)
    with suppress(OSError):
        sys.stderr.write(told)
        sys.stderr.flush()


def freeze_heap() -> None:
    """Return free memory to the system, and exempt all objects from garbage collection."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only
        if trim is not None:
            trim(0)
    gc.freeze()


def final_note(shell: Shell, part: ActorProcess, cpu_s: float) -> FinalNote:
    """Return the last record of a process that ran to its end."""
    report = part.outcome()
    told = msgspec.structs.asdict(report) if isinstance(report, msgspec.Struct) else report
    return FinalNote(
        digest=shell.counts.hash.digest(shell.actor),
        published=shell.counts.published,
        received=shell.counts.received,
        unread=shell.unread,
        cpu_s=cpu_s,
        startup_cpu_s=shell.first_advance.cpu_s,
        started_s=shell.first_advance.wall_s,
        ended_s=time.time(),
        sent=dict(shell.counts.sent),
        arrived=dict(shell.counts.arrived),
        outcome={name: msgspec.Raw(msgspec.json.encode(value)) for name, value in told.items()},
        code=part.code(),
    )
