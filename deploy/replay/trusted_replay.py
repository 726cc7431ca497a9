"""A recording replayed as the command line does: its code named first, then run shut off from everything."""

import re
import tempfile
from pathlib import Path
from typing import Final

import msgspec

from actors.robot.program import code_of
from actors.runtime.bus.replay_bus import ReplayError
from deploy.processes.launch import Program, launcher
from deploy.replay.moved_runs import run_of
from deploy.replay.record_replay import ReplayReport, replay_actor
from deploy.replay.replay_program import ReplayAnswer
from deploy.replay.run_recordings import recordings
from deploy.run.foreign import folder_of, refuse_foreign, refuse_missing
from deploy.run.isolating import choose, warn
from deploy.run.preflight import said, show

_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes on board that serve devices: no program executes those again."""
ANSWER_BYTES = 1 << 16
"""A difference between two messages is one sentence, with both of them in it."""


def replay(out: Path, actor: str, *, trust: bool, isolate: bool | None) -> ReplayReport:
    """Execute one actor again; a robot in a process that is shut off, where the machine can and `isolate`
    lets it.

    World and radio run no code but this project's. Raises ForeignCodeError for a robot whose recording names
    somebody's code, without `trust`; ReplayError at the first output that differs.
    """
    named = check_trust(out, actor, trust=trust)
    if named is None:
        return replay_actor(out, actor)
    entry, folders = named
    choice = choose(isolate)
    warn(choice.warning)
    if isolate is False:
        return replay_actor(out, actor)  # in this process, where a debugger may be
    with tempfile.TemporaryDirectory(prefix="acrc") as name:
        home = Path(name).resolve()
        (home / "own").mkdir()
        code = folder_of(entry, folders)
        argv = (
            *("--out", str(out.resolve()), "--actor", actor),
            *("--answer", str(home / "answer.json"), "--own", str(home / "own")),
            *(() if code is None else ("--path", str(code))),
            *(("--isolate",) if choice.isolate else ()),
        )
        return _answer(Program(actor, "deploy.replay.replay_program", argv, home / "replay.log", None), home)


def check_trust(out: Path, actor: str, *, trust: bool) -> tuple[str, tuple[Path, ...]] | None:
    """The entry of a robot's recorded code and the folders it is looked for in; None for world and radio.

    They run no code but this project's. Raises ForeignCodeError for somebody's code, without `trust`, and
    MissingCodeError for code that is not here.
    """
    files = recordings(out)
    if actor in files and _ON_DEVICES.search(actor):
        raise ReplayError(f"{actor}: is a process with devices on board; must be a robot, world or radio")
    if actor not in files or actor in {"world", "radio"}:
        return None
    entry, folders = code_of(run_of(files[actor]).argv)
    refuse_missing(files[actor], entry, folders)
    if not trust:
        refuse_foreign(files[actor], entry, folders)
    return entry, folders


def _answer(program: Program, home: Path) -> ReplayReport:
    """What the process has to say; ReplayError if that is a fault, or nothing."""
    with launcher("exec") as launched:
        child = launched.start(program)
        while child.exit_code is None:
            launched.wait(0.5)
    show(said(program))
    try:
        with (home / "answer.json").open("rb") as file:
            answer = msgspec.json.decode(file.read(ANSWER_BYTES), type=ReplayAnswer)
    except (OSError, msgspec.DecodeError):
        answer = ReplayAnswer()
    if answer.report is None:
        ended = f"{program.actor}: the process that executes it again ended with exit code {child.exit_code}"
        raise ReplayError(answer.fault or ended)
    return answer.report
