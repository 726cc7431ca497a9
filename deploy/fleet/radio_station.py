"""`acrc fleet radio`: the simulated radio medium of robots without boards, on one computer.

Robots connect over TLS. The name in a robot's certificate limits it to its own keys: it can neither send nor
receive as another. Its lines go to its simulated transceiver. Positions are the robots' own estimates; a
robot without a recent one on the map is off the medium. A wrong estimate changes the reception by and of its
own robot only.
"""

import select
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.installation.usage import OptionError
from actors.installation.version import software_version
from actors.instant import Instant, seconds
from actors.messages import FRAME_OUTCOMES, RECEIVED, TRANSMIT, FrameOutcomes
from actors.processes.launcher import scratch_folder
from actors.radio.program import KERNELS
from actors.radio.radio_model import RadioSetup, preset
from actors.runtime.background import BackgroundRecorder
from actors.runtime.core import Address, Inputs, Output, at, to
from actors.runtime.isolation import credentials
from actors.runtime.isolation.tls import RADIO_STATION, listening_router_config, load_keys
from actors.runtime.process import ActorProcess, run_actor, run_note
from actors.runtime.processor import fingerprints
from actors.runtime.shell import Shell
from actors.runtime.zenoh_bus import SelectableBus
from actors.topic import sender
from deploy.fleet.fleet_file import Fleet
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.beeclick.emulated_medium import BodyState, create_medium
from firmware_bridge.device_lines import SimulatedTransceiver
from firmware_bridge.onboard.base import check_endpoint
from firmware_bridge.onboard.device_loop import Clock, TimedCore
from firmware_bridge.serial_port import Say, changed_only

POSITION_TIMEOUT: Final = seconds(2.0)
"""Time since its arrival after which a position is not used; own choice: 20 reports."""
_OFF: Final = -1
"""Code of no channel."""


class LineBus(SelectableBus):
    """Bus for lines of robots, which may send too many."""

    QUEUE = 256


class MediumCore(TimedCore):
    """Medium of a fleet, in real time from 0 on; records the outcome of each frame."""

    def __init__(self, setup: RadioSetup, say: Say) -> None:
        """Create it; `say`: logs which robots are on the medium. Raises AcrcError."""
        super().__init__()
        self._grid, self._step_us, self._medium = load_map(setup.map), setup.step_us, create_medium(setup)
        channel = setup.channel or preset(setup.preset).channel
        self.robots: Mapping[str, SimulatedTransceiver] = {
            robot: SimulatedTransceiver(self._medium, BoardSettings(address, channel))
            for robot, address in setup.robots
        }
        """Transceivers by robot."""
        self.lost_lines = 0
        """Number of lines that robots sent too fast."""
        self._say = {robot: changed_only(say) for robot in self.robots}
        for transceiver in self.robots.values():
            self._tuned = transceiver.channel
            self._medium.add(transceiver)

    @property
    def wake(self) -> Instant:
        """Time of the next event on the medium, or of the next step."""
        step_end = Instant((self.step + 1) * self._step_us)
        return min(step_end, self._medium.wake() or step_end)

    def listens(self) -> Sequence[Address]:
        """Return the addresses of lines from robots."""
        return [at(TRANSMIT, robot) for robot in self.robots]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Simulate the medium until now."""
        states = [self._state(robot, one) for robot, one in self.robots.items()]
        self._medium.set_states(self.now, states)
        self._medium.advance(self.now)
        self.step = self.now // self._step_us
        outcomes = self._medium.take_outcomes()
        return [to(FRAME_OUTCOMES, FrameOutcomes(self.step, outcomes))] if outcomes else ()

    def outcome(self) -> dict[str, object]:
        """Return all counters: of frames, as in a simulated run, and of each robot's lines."""
        robots = self.robots.items()
        return {
            "frames": self._medium.counters(),
            "frames_by_robot": self._medium.counters_by_robot([*self.robots]),
            "refused_frames": {robot: one.refused for robot, one in robots},
            "lost_lines": self.lost_lines,
            "invalid_lines": {robot: one.lines.invalid_lines for robot, one in robots},
        }

    def _state(self, robot: str, transceiver: SimulatedTransceiver) -> BodyState:
        """Switch a transceiver on or off and return its place; frames accepted before are still sent."""
        x, y = transceiver.position
        is_on = self.now < transceiver.located_at + POSITION_TIMEOUT and self._grid.contains(Point(x, y))
        self._say[robot](f"{robot} is {'on' if is_on else 'off'} the medium")
        transceiver.fault = "" if is_on else "The medium has no recent position of the robot on the map."
        transceiver.channel = self._tuned if is_on or transceiver.unsettled else _OFF
        return x, y, 0.0, 0.0, 0.0, 0.0


def run(fleet: Fleet, out: Path, say: Say) -> dict[str, object]:
    """Serve the fleet's robots until SIGINT or SIGTERM; record into `out`; return all counters.

    Raises OptionError for a fleet with boards, and AcrcError for missing keys or an unusable endpoint.
    """
    if (endpoint := fleet.radio.network) is None:
        raise OptionError(
            f'{fleet.path}: radio.network is missing; set it, and radio = "network" of all robots'
        )
    keys, setup = load_keys(fleet.key_folder(RADIO_STATION)), fleet.medium
    check_endpoint(endpoint, "radio.network")
    core = MediumCore(setup, say)
    process = ActorProcess(
        core=core,
        listens=core.listens(),
        run=run_note(RADIO_STATION, setup, software_version(), kernels=fingerprints(KERNELS)),
        bus=LineBus,
        drive=lambda shell, bus: _drive(core, shell, bus),
        outcome=core.outcome,
    )
    with scratch_folder() as folder:
        issued = credentials.issue({}, folder, ())
        config = listening_router_config(issued, keys, [endpoint], [*core.robots])
        recorder = BackgroundRecorder(out / f"{RADIO_STATION}.mcap", setup.step_us)
        run_actor(process, recorder, config, lambda: say(f"the medium listens at {endpoint}"))
    return core.outcome()


def _drive(core: MediumCore, shell: Shell, bus: LineBus) -> None:
    clock, stopped = Clock(from_zero=True), list[int]()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    while not stopped:
        select.select([bus.fileno()], [], [], max(0.0, (core.wake - clock.now()) / 1e6))
        core.now = clock.now()
        shell.pump()
        for delivery in bus.take():
            core.robots[str(sender(delivery.key))].take(core.now, delivery.payload)
        for robot, transceiver in core.robots.items():
            if data := transceiver.run(core.now):
                bus.publish(RECEIVED.key(robot), data)
        core.lost_lines = bus.dropped
