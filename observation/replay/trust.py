"""Whether the code that a recording names may run here: it is found without running it, and named first."""

import re
from functools import cache
from pathlib import Path
from typing import Final

from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.foreign import Permit, admitted
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.isolation.sandbox import warn
from observation.replay.recorded_setup import code_folders, run_of, told
from observation.replay.run_recordings import all_recordings

_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes on board that serve devices: no program replays those."""


def check_trust(out: Path, actor: str, permit: Permit) -> tuple[Path, ...] | None:
    """The folders that a robot's recorded code may be looked for in; None for world and radio.

    They run no code but this project's. Raises AcrcError for code that the permit does not cover, and
    AcrcError for code that is not here. Code that was recorded without its hashes is said to be so.
    """
    files = all_recordings(out)
    if actor in files and _ON_DEVICES.search(actor):
        raise ReplayError(f"{actor}: is a process with devices on board; must be a robot, world or radio")
    if actor not in files or actor in {"world", "radio"}:
        return None
    run = run_of(files[actor])
    entry = told(files[actor], run, RobotSetup, "a robot").behaviour
    folders = admitted(files[actor], entry, code_folders(out), permit)
    if folders and run.code is None and not permit.trust:
        say_unhashed(files[actor])
    return folders


@cache
def say_unhashed(place: Path) -> None:
    """Say once on standard error that nobody can tell whether a strategy is the recorded one."""
    warn(f"{place}: was recorded without the hashes of its strategy's modules, which may be others here")
