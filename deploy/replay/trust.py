"""Whether the code that a recording names may run here: it is found without running it, and named first."""

import re
from pathlib import Path
from typing import Final

from actors.robot.program import code_of
from actors.runtime.bus.replay_bus import ReplayError
from deploy.replay.moved_runs import run_of
from deploy.replay.run_recordings import recordings
from deploy.run.foreign import refuse_foreign, refuse_missing

_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes on board that serve devices: no program executes those again."""


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
