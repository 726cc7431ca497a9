"""What a recorded process was started with, where that lies now: a run's folder may be moved or copied.

A recording names files as they were called when it was made. Those of the run's folder are looked for in the
folder where the recording lies now; folders with code, where they were, and else as they lay beside the run.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from actors.processes.real_names import NAMES, RealNames
from actors.radio.radio_setup import RadioSetup
from actors.runtime.isolation.neutral import FOLDER, code
from actors.runtime.process import RunNote
from actors.runtime.recording import RecordingError, decoded, read_notes
from actors.world.world_setup import WorldSetup

_MAP: Final = Path("map", "map.yaml")
_MODEL: Final = "model.toml"
_CODE: Final = "--path"
_RECORDING: Final = "--record"
_MOST_NAMES: Final = 100_000
"""Bytes of it."""


def run_of(path: Path) -> RunNote:
    """The first record of a recording, its command line with the files where they are now.

    Raises RecordingError if there is none.
    """
    notes = read_notes(path)
    if "run" not in notes:
        raise RecordingError(f"{path}: ends before its first record")
    run = decoded(path, "run", notes["run"], RunNote)
    return msgspec.structs.replace(run, argv=tuple(_moved(run.argv, path)))


def world_here(setup: WorldSetup, out: Path) -> WorldSetup:
    """The world's set-up with the map and the robot models that lie in the run's folder."""
    robots = tuple(
        msgspec.structs.replace(robot, model=_either(out / robot.id / _MODEL, robot.model))
        for robot in setup.robots
    )
    return msgspec.structs.replace(setup, robots=robots, map=_either(out / _MAP, setup.map))


def radio_here(setup: RadioSetup, out: Path) -> RadioSetup:
    """The radio's set-up with the map that lies in the run's folder."""
    return msgspec.structs.replace(setup, map=_either(out / _MAP, setup.map)) if setup.map else setup


def map_here(setup: WorldSetup, out: Path) -> str:
    """The map's file; that which lies in the folder, wherever the folder was taken."""
    return _either(out / _MAP, setup.map)


def _either(beside: Path, named: str) -> str:
    return str(beside if beside.is_file() else named)


def _moved(argv: Sequence[str], path: Path) -> Iterator[str]:
    """The words of a command line; what lay in the run's folder stands there as it is called now."""
    if _RECORDING not in argv[:-1]:
        yield from argv
        return
    record = Path(argv[argv.index(_RECORDING) + 1])
    now = path.resolve().parent.parent
    if record.parent == FOLDER:
        real = _names(now)
        argv = [_called(word, real, path.resolve().parent.name) for word in argv]
        record = Path(real.out, path.resolve().parent.name, record.name)
    then = record.parent.parent
    before = ""
    for word in argv:
        yield _place(word, then, now, is_code=before == _CODE)
        before = word


def _names(out: Path) -> RealNames:
    """What robots saw under other names; the folder as it is called now, where the run does not say it."""
    file = out / NAMES
    if not file.is_file() or file.is_symlink():
        return RealNames(str(out))
    with file.open("rb") as stream:
        text = stream.read(_MOST_NAMES)
    try:
        return msgspec.json.decode(text, type=RealNames)
    except (msgspec.MsgspecError, ValueError) as error:
        raise RecordingError(f"{file}: {error}") from None


def _called(word: str, real: RealNames, robot: str) -> str:
    """A word as it would have been without other names."""
    folders = zip(code(len(real.code)), real.code, strict=True)
    for seen, path in ((FOLDER, str(Path(real.out, robot))), *folders):
        before, here, rest = word.partition(str(seen))  # an endpoint has the socket's path in it
        if here and rest[:1] in {"", "/"} and (not before or before.endswith("stream/")):
            return f"{before}{path}{rest}"
    return word


def _place(word: str, then: Path, now: Path, *, is_code: bool) -> str:
    """Where a file or folder of the command line is; any other word as it is."""
    named = Path(word)
    if then == now or "\0" in word or not named.is_absolute():
        return word
    if is_code:
        beside = Path(os.path.normpath(now / os.path.relpath(named, then)))
        return str(beside) if beside.is_dir() and not named.is_dir() else word
    if not named.is_relative_to(then):
        return word
    inside = now / named.relative_to(then)
    return str(inside) if inside.exists() or not named.exists() else word
