"""The world's process: its command line, its core, and the router that it is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final

import msgspec

from actors.floor import distance, flood
from actors.messages import PROGRESS
from actors.portable import arrays, draws, foundations
from actors.runtime import regular_file
from actors.runtime.bus.quota_bus import QuotaBus
from actors.runtime.bus_interface import Bus
from actors.runtime.client_options import ArgumentParser
from actors.runtime.core import to
from actors.runtime.errors import AcrcError
from actors.runtime.fingerprint import fingerprints
from actors.runtime.pace import Pace
from actors.runtime.process import ActorProcess, RunNote, run_note
from actors.runtime.shell import Shell, run_shell
from actors.runtime.spans import Window, add_span_option
from actors.runtime.ticks import ticking
from actors.task import visits
from actors.task.referee import Referee
from actors.world import drive, odometry_kernel, physics, rays
from actors.world.body import Bodies
from actors.world.core import WorldCore
from actors.world.world_setup import WorldSetup

KERNELS: Final = (foundations, arrays, draws, odometry_kernel, drive, physics, rays, visits, distance, flood)
"""Modules with numeric kernels that a world computes with."""


class SetupError(AcrcError):
    """A set-up file that does not decode."""


@dataclass(frozen=True)
class WorldOptions:
    """The world's command line."""

    setup: Path
    """JSON file with a WorldSetup."""
    router: Path
    """JSON file with the actors that the router knows, as `actors.runtime.access.router_file` writes it."""
    record: Path
    commit: str
    speed: float | None
    """Simulated seconds per second; None = as fast as possible."""
    with_parent: bool
    """End as soon as the process that started this one has ended."""
    spans: Window | None
    """Steps in which what it does is noted, span by span."""


def parse(argv: Sequence[str]) -> WorldOptions:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(prog="python -m actors.world", description="Conducts a run.")
    parser.add_argument("--setup", required=True, type=Path, help="JSON file with the world's set-up")
    parser.add_argument("--router", required=True, type=Path, help="JSON file with whom the router knows")
    parser.add_argument("--record", required=True, type=Path, help="MCAP file to write")
    parser.add_argument("--commit", default="", help="version of the software, for the first record")
    parser.add_argument("--speed", default="max", help='"max", or simulated seconds per second')
    parser.add_argument("--with-parent", action="store_true", help="end when the starting process ends")
    add_span_option(parser)
    given = parser.parse_args(argv)
    speed = None if given.speed == "max" else float(given.speed)
    return WorldOptions(
        given.setup, given.router, given.record, given.commit, speed, given.with_parent, given.spans
    )


def load_setup(path: Path) -> WorldSetup:
    """The set-up in a JSON file."""
    try:
        return msgspec.json.decode(regular_file.content(path), type=WorldSetup)
    except (OSError, ValueError, RecursionError) as error:
        raise SetupError(f"{path}: no set-up of a world: {str(error)[:300]}") from None


def build(setup: WorldSetup) -> WorldCore:
    """The core of a world whose task is to visit places."""
    return WorldCore(setup, Bodies(setup), Referee(setup.robots, setup.reach))


def part_of(
    argv: Sequence[str], settle: Callable[[WorldSetup], WorldSetup] = lambda setup: setup
) -> ActorProcess:
    """The world that `argv` describes, without a conductor's clock: for replays.

    `settle` is given the set-up, and says where its files are.
    """
    options = parse(argv)
    setup = settle(load_setup(options.setup))
    return part(build(setup), world_note(setup, argv, options.commit))


def part(
    core: WorldCore,
    run: RunNote,
    hold: Callable[[Shell, Bus], None] = run_shell,
    spans: Window | None = None,
) -> ActorProcess:
    """The core and its connections."""
    return ActorProcess(
        core=core,
        listens=core.listens(),
        run=run,
        open_to=core.open_to,
        bus=QuotaBus,
        drive=hold,
        outcome=lambda: {
            **core.task_outcome,
            "contacts": core.contacts,
            "pose_errors": core.pose_errors,
            "driven": core.driven,
            "steps": core.step,
            "refused_orders": core.refused_orders,
        },
        spans=spans,
    )


def world_note(setup: WorldSetup, argv: Sequence[str], commit: str) -> RunNote:
    """The first record of the world's file."""
    return run_note("world", argv, setup, commit, seed=setup.seed, kernels=fingerprints(KERNELS))


class Conductor:
    """Drives the world over the mesh: keeps the pace, and says what it waits for when it waits long."""

    TICK_S: Final = 0.25
    """It has said so before half of the shortest timeout is over, and is not blamed itself."""

    def __init__(self, core: WorldCore, speed: float | None) -> None:
        self._core = core
        self._pace = None if speed is None else Pace(speed)
        self._heard: float | None = None

    def drive(self, shell: Shell, bus: Bus) -> None:
        """Run to the end."""
        seen = -1

        def tick(frame: FrameType | None) -> None:
            nonlocal seen
            if shell.advances == seen and not self._core.paused:
                shell.send(to(PROGRESS, self._core.waiting(shell.awaited)))
            seen = shell.advances

        with ticking(self.TICK_S, tick):
            run_shell(shell, bus, self.hold)

    def hold(self) -> None:
        """Wait until the next step is due, at the speed that was ordered last."""
        if self._core.speed != self._heard:
            self._heard = self._core.speed
            self._pace = Pace(self._heard) if self._heard else None
        if self._pace is None:
            return
        if self._core.paused:
            self._pace.restart()
        elif self._core.opening:
            self._pace.hold(self._core.instant)
