"""The radio's process: its command line, its set-up and its core."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.messages import RADIO_READY, TRANSMIT, TRUTH, Ready
from actors.portable import arrays, foundations
from actors.portable import draws as portable_draws
from actors.radio import transceiver_truth
from actors.radio.core import RadioCore
from actors.radio.medium import medium
from actors.radio.propagation import indoor
from actors.radio.radio_model import radio_model
from actors.radio.radio_setup import RadioSetup
from actors.runtime import regular_file
from actors.runtime.bus.quota_bus import QuotaBus
from actors.runtime.client_options import ArgumentParser, ClientOptions, add_client_options, client_options
from actors.runtime.core import at, to
from actors.runtime.errors import AcrcError
from actors.runtime.fingerprint import combined, fingerprints
from actors.runtime.process import ActorProcess, run_note

KERNELS = (foundations, arrays, portable_draws, indoor, medium, transceiver_truth)
"""Modules with numeric kernels that a radio computes with."""
GREATEST_ADDRESS = 0xFFFD
"""0xFFFE and 0xFFFF mean "no address" and "everyone" (IEEE 802.15.4-2006, 7.2.1)."""


def build(setup: RadioSetup) -> RadioCore:
    """The core, before its first step; AcrcError if the set-up makes no sense."""
    model = radio_model(setup)
    if setup.step_us < 1:
        raise AcrcError(f"The radio's step is {setup.step_us} µs long; it must be at least 1 µs.")
    owners: dict[int, str] = {}
    names: set[str] = set()
    for robot, address in setup.robots:
        if not 0 <= address <= GREATEST_ADDRESS:
            raise AcrcError(
                f"Robot {robot} has the short address {address}; it must be 0 to {GREATEST_ADDRESS}."
            )
        if address in owners:
            raise AcrcError(
                f"Robots {owners[address]} and {robot} share the short address {address}; each needs its own."
            )
        if robot in names:
            raise AcrcError(f"Robot {robot} is listed twice for the radio; each robot needs one entry.")
        owners[address] = robot
        names.add(robot)
    return RadioCore(setup.robots, setup.step_us, model, setup.seed)


@dataclass(frozen=True)
class RadioOptions:
    """The radio's command line."""

    setup: Path
    """JSON file with a RadioSetup."""
    client: ClientOptions


def parse(argv: Sequence[str]) -> RadioOptions:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(prog="python -m actors.radio", description="Simulates the radio medium.")
    parser.add_argument("--setup", required=True, type=Path, help="JSON file with the radio's set-up")
    add_client_options(parser)
    given = parser.parse_args(argv)
    return RadioOptions(given.setup, client_options(given))


def load_setup(path: Path) -> RadioSetup:
    """The set-up in a JSON file; AcrcError if there is none."""
    try:
        return msgspec.json.decode(regular_file.content(path), type=RadioSetup)
    except (OSError, ValueError, RecursionError) as error:
        raise AcrcError(f"{path}: no set-up of a radio: {str(error)[:300]}") from None


def part(
    argv: Sequence[str], settle: Callable[[RadioSetup], RadioSetup] = lambda setup: setup
) -> ActorProcess:
    """The radio that `argv` describes, with its connections.

    `settle` is given the set-up, and says where its files are: a replay may find them elsewhere.
    """
    options = parse(argv)
    setup = settle(load_setup(options.setup))
    prints = fingerprints(KERNELS)
    core = build(setup)
    run = run_note("radio", argv, setup, options.client.commit, seed=setup.seed, kernels=prints)
    return ActorProcess(
        core=core,
        listens=(at(TRUTH), at(TRANSMIT, "*")),
        run=run,
        bus=QuotaBus,
        ready=to(RADIO_READY, Ready(0, "radio", 0, combined(prints))),
        outcome=lambda: {"frames": core.counters(), "frames_by_robot": core.counters_by_robot()},
        spans=options.client.spans,
    )
