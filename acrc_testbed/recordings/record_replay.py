"""Replay of actors from their recordings."""

import bdb
import importlib.util
import os
import pkgutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import msgspec

from acrc_testbed.recordings.record_check import check_run
from acrc_testbed.recordings.run_recordings import all_recordings, decode_setup, read_run_note
from actors.installation.repository import REPOSITORY
from actors.installation.usage import command_name
from actors.instant import Instant, seconds
from actors.radio.program import actor_process as radio_process
from actors.radio.radio_model import RadioSetup
from actors.robot.assembly import RobotSetup
from actors.robot.program import actor_process_of
from actors.runtime import failure
from actors.runtime.captured_output import CapturedOutput, discarded_output
from actors.runtime.core import Core, Inputs, Output
from actors.runtime.debugger import UserPdb
from actors.runtime.errors import AcrcError
from actors.runtime.linux import die_with_parent
from actors.runtime.process import ActorProcess, FinalNote, RunNote
from actors.runtime.process_table import child_environment
from actors.runtime.processor import difference_cause, differing_kernels
from actors.runtime.recording import Entry, RecordingError, decode_note, read_notes, read_recording
from actors.runtime.replay_bus import ReplayBus, ReplayError, replay
from actors.runtime.shell import Shell
from actors.user_code import FINDER, RecordedModules, expect_hashes, set_folders, set_task_folders
from actors.world import program as world_program
from actors.world.world_setup import WorldSetup


class ReplayStoppedError(Exception):
    """End of a replay: its time window is over, or the user quit the debugger."""


def limit_replay(
    core: Core, step_us: int, begin_s: float, end_s: float | None, stops: list[Callable[[], None]]
) -> None:
    """Pop and call the last of `stops` at `begin_s`; raise ReplayStoppedError after `end_s`."""
    advance, begin = core.advance, seconds(begin_s)
    end = None if end_s is None else seconds(end_s)

    def limited_advance(inputs: Inputs) -> Sequence[Output]:
        instant = Instant(core.step * step_us)
        if end is not None and instant > end:
            raise ReplayStoppedError
        if stops and instant >= begin:
            stops.pop()()
        try:
            return advance(inputs)
        except bdb.BdbQuit:
            raise ReplayStoppedError from None

    cast(Any, core).advance = limited_advance


def pdb_breakpoint(*, own: bool) -> Callable[[], None]:
    """Return a call that stops pdb at the next line of the user's code; `own`: as in `UserPdb`."""
    return _ReplayPdb(own=own).set_trace


class _ReplayPdb(UserPdb):
    """A debugger that imports the module of a breakpoint."""

    def lineinfo(self, identifier: str) -> Any:
        """Find a function by its full name, such as `cleaning.robot.CleaningRobot.drive`."""
        try:
            code = pkgutil.resolve_name(identifier).__code__
        except (ValueError, ImportError, AttributeError):
            return super().lineinfo(identifier)
        return code.co_name, code.co_filename, code.co_firstlineno


def debugpy_breakpoint(port: int) -> Callable[[], None]:
    """Wait for a debugger at a local port, and return a call that stops it in the user's code.

    Raises AcrcError if the package debugpy is missing.
    """
    if importlib.util.find_spec("debugpy") is None:
        raise AcrcError(f"--debugpy {port}: debugpy is not installed; run `{command_name()} add debugpy`")
    debugpy: Any = importlib.import_module("debugpy")
    debugpy.listen(("127.0.0.1", port))
    debugpy.wait_for_client()
    return cast(Callable[[], None], debugpy.breakpoint)


@dataclass(frozen=True)
class ReplayReport:
    """Result of one actor's replay."""

    actor: str
    outputs: int
    """Number of messages, all equal to the recorded ones."""
    whole: bool = True
    """False: only up to the end of the time window."""
    decisions: str = ""
    """First different decision of another strategy; empty: the outputs were compared instead."""


@dataclass(frozen=True)
class ReplayOptions:
    """Options of an actor's replay."""

    prepare: Callable[[Core, int], None] | None = None
    """Called before the first step with the actor's core and the length of a step, µs. The core may raise
    ReplayStoppedError to end the replay."""
    behaviour: str | None = None
    """Entry string of a behaviour that replaces the recorded one, with its default settings; outputs are not
    compared."""
    prints: Callable[[int], CapturedOutput] | None = None
    """Returns a capture of printed output for a length of a step; None: no capture."""


def replay_actor(out: Path, actor: str, replay_options: ReplayOptions = ReplayOptions()) -> ReplayReport:
    """Run one actor on its recorded inputs. Raises ReplayError at the first output that differs.

    Code is loaded from this process's search path (`set_folders`), not from the recorded one. Raises
    RecordingError without a recording, AcrcError for a module that differs from the recorded one.
    """
    files = all_recordings(out)
    if actor not in files:
        raise RecordingError(
            f"{out}: no recording of {actor!r}; choose from {', '.join(files)}; --from gives an instant"
        )
    path = files[actor]
    run = read_run_note(path)
    prints = None if replay_options.prints is None else replay_options.prints(run.step_us)
    with nullcontext() if prints is None else prints.during(0):
        expect_hashes(
            None if run.code is None or replay_options.behaviour is not None else _modules_of(path, run.code)
        )
        process = _build_process(path, actor, run, replay_options)
    if replay_options.prepare is not None:
        replay_options.prepare(process.core, run.step_us)
    bus = ReplayBus(path, lambda sha256: _find_message(files.values(), sha256))
    if replay_options.behaviour is not None:
        cast(Any, bus).publish = cast(Any, bus).close = lambda *output: None  # its outputs differ
    shell = Shell(process.core, bus, bus, actor=run.actor, optional_inputs=process.optional_inputs)
    if process.ready is not None:
        shell.send(process.ready)
    shell.prints = prints
    try:
        replay(shell, bus)
    except ReplayStoppedError:
        return ReplayReport(actor, bus.compared, whole=False)
    except ReplayError as error:
        here = process.run
        cause = difference_cause(run.processor, here.processor, differing_kernels(run.kernels, here.kernels))
        raise (ReplayError(f"{error}; {cause}") if cause else error) from None
    return ReplayReport(actor, bus.compared)


_RECHECK: Final = (
    "import sys; from acrc_testbed.recordings.record_replay import replay_all; "
    "sys.exit(replay_all(sys.argv[1:]))"
)
_MAX_FAULT: Final = 2000
"""Limit of a fault, characters; less than a pipe's buffer."""


class RecheckError(AcrcError):
    """A run whose replay differs."""


class RecheckedActor(msgspec.Struct, frozen=True):
    """Result of one actor's replay in `recheck`."""

    actor: str
    outputs: int = 0
    """Number of messages, all equal."""
    fault: str | None = None
    """Description of the difference; None: there is none."""


@dataclass(frozen=True)
class RecheckReport:
    """Result of a successful `recheck`."""

    actors: int
    outputs: int


def recheck(out: Path, modules: Sequence[Path] = ()) -> RecheckReport:
    """Check a run's recordings, and replay every actor in a new process with another hash seed.

    Raises RecheckError with all differences. A replay differs if an actor depends on more than its inputs: a
    clock, its own random numbers, the order of a set, an id().

    `modules`: folders of the run's strategy.
    """
    check_run(out)
    actors = tuple(all_recordings(out))
    tasks = FINDER.task_folders
    words = (len(modules), *modules, len(tasks), *tasks, out, *actors)
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    with subprocess.Popen(
        [sys.executable, "-P", "-c", _RECHECK, *map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        cwd=REPOSITORY,
        env=child_environment(os.environ) | {"PYTHONHASHSEED": other},
    ) as process:
        assert process.stdout is not None
        try:
            results = [msgspec.json.decode(line, type=RecheckedActor) for line in process.stdout]
        except BaseException:
            process.kill()
            raise
    if len(results) != len(actors):
        raise RecheckError(
            f"{out}: replay failed: its process exited with code {process.returncode}; see its output above"
        )
    results.sort(key=lambda one: actors.index(one.actor))
    faults = {one.actor: one.fault for one in results if one.fault is not None}
    if faults:
        raise RecheckError(
            f"{' and '.join(faults)}: the replay differs, so the code depends on more than its inputs, such "
            "as a clock, its own random numbers, the order of a set or id(). " + "; ".join(faults.values())
        )
    return RecheckReport(len(results), sum(one.outputs for one in results))


def replay_all(argv: Sequence[str]) -> int:
    """Replay actors in parallel, one per processor, and write a line of JSON for each.

    `argv`: number N, N folders with modules, number M, M folders of tasks, the run's folder, the actors.
    """
    die_with_parent(os.getppid())
    words = deque(argv)
    for search_in in (set_folders, set_task_folders):
        search_in([Path(words.popleft()) for _ in range(int(words.popleft()))])
    out, *actors = words
    importlib.import_module("actors.processes.preload")
    for result in _replay_parallel(Path(out), actors):
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
        sys.stdout.flush()
    return 0


def _replay_parallel(out: Path, actors: Sequence[str]) -> Iterator[RecheckedActor]:
    waiting, running = deque(actors), dict[int, tuple[str, int]]()
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            actor = waiting.popleft()
            pid, pipe = _fork_replay(out, actor)
            running[pid] = (actor, pipe)
        pid, status = os.wait()
        if pid not in running:
            continue  # a child of a process that a strategy started
        actor, pipe = running.pop(pid)
        with os.fdopen(pipe, "rb") as answer:
            text = answer.read(1 << 16) if status == 0 else b""
        code = os.waitstatus_to_exitcode(status)
        ended = RecheckedActor(actor, fault=f"{actor}: the process exited with code {code}")
        yield msgspec.json.decode(text, type=RecheckedActor) if text else ended


def _fork_replay(out: Path, actor: str) -> tuple[int, int]:
    """Fork a process for one actor; return its pid and the descriptor of its answer."""
    mine, theirs = os.pipe()
    parent = os.getpid()
    pid = os.fork()
    if pid:
        os.close(theirs)
        return pid, mine
    code = 1
    try:
        die_with_parent(parent)
        failure.hold_reserve(Path(tempfile.gettempdir()))
        os.dup2(2, 1)  # prints of a strategy must not mix with the answer
        os.write(theirs, msgspec.json.encode(_replay_one(out, actor)))
        code = 0
    finally:
        os._exit(code)


def _replay_one(out: Path, actor: str) -> RecheckedActor:
    try:
        silent = ReplayOptions(prints=lambda step_us: discarded_output())  # the run itself has printed it
        return RecheckedActor(actor, replay_actor(out, actor, silent).outputs)
    except AcrcError as error:
        return RecheckedActor(actor, fault=str(error)[:_MAX_FAULT])
    except Exception as error:  # a strategy that diverges may fail
        failure.release_reserve()
        return RecheckedActor(actor, fault=f"{actor}: {type(error).__name__}: {error}"[:_MAX_FAULT])


def _modules_of(path: Path, code: dict[str, str]) -> RecordedModules:
    """Return the recorded modules of a process, with their hashes."""
    notes = read_notes(path)
    if "final" not in notes:
        return RecordedModules(code, whole=False)
    return RecordedModules(code | decode_note(path, "final", notes["final"], FinalNote).code)


def recorded_code(out: Path) -> RecordedModules | None:
    """Return the modules of a run's robots; None if none were recorded."""
    files = all_recordings(out)
    runs = [(path, read_run_note(path)) for actor, path in files.items() if actor not in {"world", "radio"}]
    known = [_modules_of(path, run.code) for path, run in runs if run.code is not None]
    if not known:
        return None
    hashes = {name: sha256 for one in known for name, sha256 in one.hashes.items()}
    return RecordedModules(hashes, all(one.whole for one in known))


def _build_process(path: Path, actor: str, run: RunNote, replay_options: ReplayOptions) -> ActorProcess:
    """Build the recorded actor, with the behaviour replaced if `replay_options` names one."""
    folder = path.parent
    if actor == "world":
        return world_program.actor_process_of(
            decode_setup(path, run, WorldSetup, "a world"), folder, run.commit
        )
    if actor == "radio":
        return radio_process(decode_setup(path, run, RadioSetup, "a radio"), folder, run.commit)
    setup = decode_setup(path, run, RobotSetup, "a robot")
    if replay_options.behaviour is not None:  # the settings belong to the strategy that was recorded
        adaptation = msgspec.structs.replace(setup.adaptation, settings={})
        setup = msgspec.structs.replace(setup, behaviour=replay_options.behaviour, adaptation=adaptation)
    return actor_process_of(setup, folder, run.actor, run.commit)


def _find_message(files: Iterable[Path], sha256: bytes) -> bytes | None:
    """Find a large message in its receiver's recording."""
    for path in files:
        try:
            for item in read_recording(path):
                if isinstance(item, Entry) and item.payload is not None and item.sha256 == sha256:
                    return item.payload
        except AcrcError:
            continue  # damage of another actor's file does not matter here
    return None
