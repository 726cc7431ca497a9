"""Batteries of the robots: charges and energies in whole microjoules, integrated step by step.

The power of a robot is the sum of its electronics, its range sensor, its transceiver and its motors, whose
power is a function of the velocity, as modelled and measured by Mei, Lu, Hu and Lee, "A case study of mobile
robot's energy consumption and conservation techniques" (ICAR 2005). Not modelled: acceleration, pushing and
blocked wheels; voltage, temperature and ageing of the battery.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from actors.instant import Instant, in_seconds
from actors.messages import RobotTruth
from actors.robot_model import BatteryParameters, RobotModel
from actors.runtime.errors import AcrcError
from actors.world.world_setup import WorldSetup

CONSUMERS: Final = ("electronics", "sensor", "radio", "motors")
_UJ: Final = 1_000_000


class EnergyReport(msgspec.Struct, frozen=True):
    """Energy of one robot in a run, J: `initial` + `charged` = all consumers + what is left."""

    initial_j: float
    electronics_j: float
    sensor_j: float
    radio_j: float
    motors_j: float
    charged_j: float
    """By chargers, and by a restart with an empty battery."""
    charge: float
    """Share of the capacity that is left at the end."""
    empty_s: float | None
    """First instant at which the battery was empty, simulated s."""

    @property
    def used_j(self) -> float:
        """Energy used by all consumers."""
        return self.electronics_j + self.sensor_j + self.radio_j + self.motors_j


class BatteryState(msgspec.Struct):
    """State of one battery; energies in µJ."""

    parameters: BatteryParameters
    sensor_power: float
    initial: int
    left: int
    used: dict[str, int] = msgspec.field(default_factory=lambda: dict.fromkeys(CONSUMERS, 0))
    charged: int = 0
    empty_at: Instant | None = None
    offered: float = 0.0
    """Power of chargers in the current step, W."""
    powered: bool = True
    motor_power: float = 0.0
    """At the start of the current step, W."""

    def power_at(self, velocity: Sequence[float]) -> float:
        """Return the power of the motors, W, at vx, vy and omega."""
        vx, vy, omega = velocity
        return self.parameters.motor_power(math.sqrt(vx * vx + vy * vy), abs(omega))

    def add(self, energy: int) -> None:
        """Charge with an energy, as far as there is room."""
        energy = min(energy, self.parameters.capacity_uj - self.left)
        self.left += energy
        self.charged += energy

    def draw(self, power_at_end: float, airtime_us: float, step_us: int) -> None:
        """Draw the energy of a step; what the battery lacks is not drawn."""
        battery = self.parameters
        radio = battery.transmitting * airtime_us + battery.receiving * (step_us - airtime_us)
        motors = (self.motor_power + power_at_end) / 2
        electronics, sensor = battery.electronics * step_us, self.sensor_power * step_us
        for name, energy in zip(CONSUMERS, (electronics, sensor, radio, motors * step_us), strict=True):
            drawn = min(max(round(energy), 0), self.left)
            self.used[name] += drawn
            self.left -= drawn


class Batteries:
    """Batteries of all robots whose set-up has one, by index."""

    def __init__(self, setup: WorldSetup, models: Sequence[RobotModel]) -> None:
        """Create the batteries. Raises AcrcError for a robot whose model has no battery."""
        self._step_us = setup.step_us
        self._states: dict[int, BatteryState] = {}
        self.charges: list[float | None] = [None] * len(models)
        """Charge of each robot's battery, 0 to 1; None: not simulated."""
        for index, (robot, model) in enumerate(zip(setup.robots, models, strict=True)):
            if robot.battery is None:
                continue
            if model.battery is None:
                raise AcrcError(
                    f"{robot.id} starts with a charge of {robot.battery:g}, but its model {model.name!r} has "
                    "no table [battery]; add it or remove the charge"
                )
            initial = round(robot.battery * model.battery.capacity_uj)
            self._states[index] = BatteryState(model.battery, model.sensor.power, initial, initial)
            self._update(index)
        self.exist = bool(self._states)
        """True if any robot has a battery."""

    def charge(self, index: int, power: float) -> None:
        """Charge a robot in the step that is about to end, with a power in W up to its model's `charging`.

        Call it in every step, also for a robot that is off. A robot without battery is ignored.
        """
        if index in self._states:
            self._states[index].offered += max(power, 0.0)

    def begin(self, truths: Sequence[RobotTruth]) -> None:
        """Begin a step."""
        for index, state in self._states.items():
            truth = truths[index]
            state.powered = truth.powered
            state.motor_power = state.power_at((truth.vx, truth.vy, truth.omega))

    def end(
        self, now: Instant, truth: Callable[[int], Sequence[float]], airtimes_ns: Sequence[int]
    ) -> list[int]:
        """End a step: charge and discharge; return the robots whose batteries have become empty.

        `truth`: as `Bodies.truth`. A robot that is off draws nothing. Raises AcrcError without airtimes.
        """
        if len(airtimes_ns) != len(self.charges):
            raise AcrcError(
                f"the radio reports the airtimes of {len(airtimes_ns)} robots; expected {len(self.charges)}"
            )
        empty = []
        for index, state in self._states.items():
            state.add(round(min(state.offered, state.parameters.charging) * self._step_us))
            state.offered = 0.0
            if state.powered:
                airtime_us = min(airtimes_ns[index] / 1000, float(self._step_us))
                state.draw(state.power_at(truth(index)[3:]), airtime_us, self._step_us)
                if not state.left:
                    empty.append(index)
                    state.empty_at = now if state.empty_at is None else state.empty_at
            self._update(index)
        return empty

    def replace_empty(self, index: int) -> None:
        """Replace an empty battery by a full one."""
        if index in self._states and not self._states[index].left:
            self._states[index].add(self._states[index].parameters.capacity_uj)
            self._update(index)

    def report(self, index: int) -> EnergyReport | None:
        """Return the energy of a robot; None without battery."""
        if index not in self._states:
            return None
        state = self._states[index]
        return EnergyReport(
            initial_j=state.initial / _UJ,
            charged_j=state.charged / _UJ,
            charge=state.left / state.parameters.capacity_uj,
            empty_s=None if state.empty_at is None else in_seconds(state.empty_at),
            **{f"{name}_j": energy / _UJ for name, energy in state.used.items()},
        )

    def _update(self, index: int) -> None:
        state = self._states[index]
        self.charges[index] = state.left / state.parameters.capacity_uj
