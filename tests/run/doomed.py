"""Program of a run whose r2 has a behaviour of `saboteur`: prints the run's error."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import msgspec

from actors.processes.monitor import Timeout
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario


class Doom(msgspec.Struct, frozen=True):
    """Behaviour of r2 and options of the run."""

    out: str
    behaviour: str
    bus: str = "zenoh"
    """zenoh, isolated or memory."""
    spawn: str = "forkserver"
    limits: dict[str, float] = {}


def sentence(doom: Doom) -> str:
    before = process_table.children(os.getpid(), process_table.processes())
    overrides = Overrides(strategy=f"tests.failures.saboteur:{doom.behaviour}", robots=2, duration=3)
    options = RunOptions(Path(doom.out), isolate=doom.bus == "isolated")
    plan = replace(swarm.plan(load_scenario(None, overrides), options), timeout=Timeout(**doom.limits))
    said = ""
    try:
        if doom.bus == "memory":
            swarm.run_in_memory(plan, lambda progress: None)
        else:
            swarm.run_processes(plan, doom.spawn, lambda progress: None)
    except AcrcError as error:
        said = str(error)
    assert process_table.children(os.getpid(), process_table.processes()) == before
    return said


def main() -> None:
    sys.stdout.write(sentence(msgspec.json.decode(sys.argv[1], type=Doom)))
