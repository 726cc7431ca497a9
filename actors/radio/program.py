"""Process of the radio: set-up and core."""

from pathlib import Path

from actors.messages import RADIO_READY, TRANSMIT, TRUTH, Ready
from actors.portable import arrays, foundations
from actors.portable import draws as portable_draws
from actors.radio import propagation, robot_medium
from actors.radio.core import RadioCore
from actors.radio.medium import medium
from actors.radio.radio_model import RadioProgram, RadioReport, RadioSetup, radio_model
from actors.runtime.core import at, to
from actors.runtime.errors import AcrcError
from actors.runtime.process import ActorProcess, run_note
from actors.runtime.process_setup import read_setup
from actors.runtime.processor import combine_fingerprints, fingerprints

KERNELS = (foundations, arrays, portable_draws, propagation, medium, robot_medium)
"""Modules with the numeric kernels of a radio."""
GREATEST_ADDRESS = 0xFFFD
"""Largest short address: 0xFFFE and 0xFFFF mean "no address" and "everyone" (IEEE 802.15.4-2006, 7.2.1)."""


def build(setup: RadioSetup) -> RadioCore:
    """Return the core before its first step. Raises AcrcError for an invalid set-up."""
    model = radio_model(setup)
    if setup.step_us < 1:
        raise AcrcError(f"The radio's step_us is {setup.step_us} µs; must be at least 1 µs.")
    owners: dict[int, str] = {}
    for robot, address in setup.robots:
        if not 0 <= address <= GREATEST_ADDRESS:
            raise AcrcError(
                f"Robot {robot} has the short address {address}; must be 0 to {GREATEST_ADDRESS}."
            )
        if address in owners:
            raise AcrcError(
                f"Robots {owners[address]} and {robot} share the short address {address}; it must be unique."
            )
        if robot in owners.values():
            raise AcrcError(f"Robot {robot} has two entries in the radio's set-up; delete one.")
        owners[address] = robot
    records = setup.detail == "full"
    return RadioCore(setup.robots, setup.step_us, model, setup.seed, records_outcomes=records)


def load_setup(path: Path) -> RadioProgram:
    """Read the set-up of a radio's process; its paths stay relative. Raises AcrcError."""
    return read_setup(path, RadioProgram, "a radio")


def actor_process(setup: RadioSetup, folder: Path, commit: str) -> ActorProcess:
    """Return the radio of a set-up in `folder`, with its connections."""
    prints = fingerprints(KERNELS, saved=True)
    core = build(setup.resolve_paths(folder))
    run = run_note("radio", setup, commit, seed=setup.seed, kernels=prints)
    return ActorProcess(
        core=core,
        listens=(at(TRUTH), at(TRANSMIT, "*")),
        run=run,
        ready=to(RADIO_READY, Ready(0, "radio", 0, combine_fingerprints(prints))),
        outcome=lambda: RadioReport(core.counters(), core.counters_by_robot()),
    )
