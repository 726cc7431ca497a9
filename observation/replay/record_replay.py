"""Actors replayed from what they received."""

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.radio.program import part as radio_part
from actors.radio.radio_model import RadioSetup
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.modules import RecordedModules, expect
from actors.robot.program import part_of
from actors.runtime.bus.replay_bus import ReplayBus, ReplayError, replay
from actors.runtime.core import Core
from actors.runtime.errors import AcrcError
from actors.runtime.prints import Prints
from actors.runtime.process import ActorProcess, FinalNote, RunNote
from actors.runtime.processor import difference, otherwise
from actors.runtime.recording import Entry, RecordingError, Unrecorded, decoded, read_notes, read_recording
from actors.runtime.shell import Shell
from actors.world import program as world_program
from actors.world.world_setup import WorldSetup
from observation.replay.debugging import EnoughError
from observation.replay.run_recordings import all_recordings, run_of, told


@dataclass(frozen=True)
class ReplayReport:
    """One actor replayed."""

    actor: str
    outputs: int
    """How many messages it sent again, all equal to the recorded ones."""
    whole: bool = True
    """False: only up to where somebody wanted to look."""


@dataclass(frozen=True)
class Onlook:
    """What somebody wants of an actor that is replayed."""

    prepare: Callable[[Core, int], None] | None = None
    """Is given the actor's core before its first step, and the length of a step, µs; EnoughError, raised by
    the core, ends the replay."""
    behaviour: str | None = None
    """Entry string of a behaviour that is to decide in place of the recorded one, on settings of its own."""
    prints: Callable[[int], Prints] | None = None
    """Makes, from the length of a step, what takes the code's prints; None: they go their way."""


@dataclass(frozen=True)
class Again:
    """An actor that is to be replayed."""

    part: ActorProcess
    run: RunNote
    """What its recording begins with."""
    path: Path
    recall: Callable[[bytes], bytes | None]
    """Gives a message of the run by its sha256."""


def made_again(out: Path, actor: str, onlook: Onlook = Onlook(), prints: Prints | None = None) -> Again:
    """The actor as it was before its first step. RecordingError where there is no recording of it.

    Its code is looked for where this process looks (`modules.look_in`), not where a recording says that it
    lay. AcrcError for a module that is not the recorded one.
    """
    files = all_recordings(out)
    if actor not in files:
        raise RecordingError(f"{out}: no recording of {actor!r}; there are {', '.join(files)}")
    path = files[actor]
    run = run_of(path)
    with nullcontext() if prints is None else prints.during(0):
        expect(None if run.code is None or onlook.behaviour is not None else _recorded(path, run.code))
        part = _part(path, actor, run, onlook)
    if onlook.prepare is not None:
        onlook.prepare(part.core, run.step_us)
    return Again(part, run, path, lambda sha256: _recall(files.values(), sha256))


def replay_actor(out: Path, actor: str, onlook: Onlook = Onlook()) -> ReplayReport:
    """Execute one actor again from what it received; ReplayError at the first output that differs."""
    files = all_recordings(out)
    prints = None
    if onlook.prints is not None and actor in files:
        prints = onlook.prints(run_of(files[actor]).step_us)
    again = made_again(out, actor, onlook, prints)
    bus = ReplayBus(again.path, again.recall)
    shell = shell_of(again, bus)
    shell.prints = prints
    try:
        replay(shell, bus)
    except EnoughError:
        return ReplayReport(actor, bus.compared, whole=False)
    except ReplayError as error:
        raise explained(error, again) from None
    return ReplayReport(actor, bus.compared)


def shell_of(again: Again, bus: ReplayBus) -> Shell:
    """The shell around an actor that is replayed; it has said that it is ready."""
    part = again.part
    shell = Shell(part.core, bus, Unrecorded(), actor=again.run.actor, open_to=part.open_to)
    if part.ready is not None:
        shell.send(part.ready)
    return shell


def explained(error: ReplayError, again: Again) -> ReplayError:
    """The same, with what is otherwise here than where it was recorded."""
    run, here = again.run, again.part.run
    why = difference(run.processor, here.processor, otherwise(run.kernels, here.kernels))
    return ReplayError(f"{error}; {why}") if why else error


def _recorded(path: Path, code: dict[str, str]) -> RecordedModules:
    """What the recorded process had loaded in the end, as far as is known."""
    notes = read_notes(path)
    if "final" not in notes:
        return RecordedModules(code, whole=False)
    return RecordedModules(code | decoded(path, "final", notes["final"], FinalNote).code)


def recorded_code(out: Path) -> RecordedModules | None:
    """What the robots of a run had loaded; None if that was not recorded of any."""
    files = all_recordings(out)
    runs = [(path, run_of(path)) for actor, path in files.items() if actor not in {"world", "radio"}]
    known = [_recorded(path, run.code) for path, run in runs if run.code is not None]
    if not known:
        return None
    hashes = {name: sha256 for one in known for name, sha256 in one.hashes.items()}
    return RecordedModules(hashes, all(one.whole for one in known))


def _part(path: Path, actor: str, run: RunNote, onlook: Onlook) -> ActorProcess:
    """The recorded actor, but for what is to decide instead."""
    folder = path.parent
    if actor == "world":
        return world_program.part_of(told(path, run, WorldSetup, "a world"), folder, run.commit)
    if actor == "radio":
        return radio_part(told(path, run, RadioSetup, "a radio"), folder, run.commit)
    setup = told(path, run, RobotSetup, "a robot")
    if onlook.behaviour is not None:  # the settings belong to the strategy that was recorded
        adaptation = msgspec.structs.replace(setup.adaptation, settings={})
        setup = msgspec.structs.replace(setup, behaviour=onlook.behaviour, adaptation=adaptation)
    return part_of(setup, folder, run.actor, run.commit)


def _recall(files: Iterable[Path], sha256: bytes) -> bytes | None:
    """A large message as its receiver recorded it."""
    for path in files:
        try:
            for item in read_recording(path):
                if isinstance(item, Entry) and item.payload is not None and item.sha256 == sha256:
                    return item.payload
        except AcrcError:
            continue  # another actor's file is damaged; that is not what was asked
    return None
