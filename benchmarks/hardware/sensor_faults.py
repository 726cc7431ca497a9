"""Faults of a robot's sensors and of its line to the base, as what is done to an emulated robot."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from benchmarks.hardware.sensor_rig import SensorRig
from firmware_bridge.range_sensors.rplidar_emulator import Lie

Act = Callable[[SensorRig], None]
AT_ONCE: Final = (0.3, 0.15)
"""s and m: where one message shows it."""
IN_CONTRADICTION: Final = (1.0, 0.5)
"""The same where two have to contradict each other."""

AT_THE_START: Final = (1.5, 0.5)
"""The same of a fault that was there before the robot moved: it speeds up by 0.3 m/s²."""


@dataclass(frozen=True)
class SensorFault:
    """One fault."""

    what: str
    how: str
    act: Act
    limit: tuple[float, float] | None = IN_CONTRADICTION
    """s and m until the wheels are told to stand; None: it is only measured."""
    bends: bool = False
    """It can be seen in a turn only: the robot drives in arcs."""
    from_start: bool = False
    """It is so before the robot first moves."""


def _base(**values: object) -> Act:
    def act(rig: SensorRig) -> None:
        for name, value in values.items():
            setattr(rig.laboratory.robots["r1"].base.faults, name, value)

    return act


def _lidar(lie: Lie) -> Act:
    return lambda rig: rig.laboratory.robots["r1"].lidar.lie(lie)


def _noise(share: float, ways: str) -> Act:
    def act(rig: SensorRig) -> None:
        vehicle = rig.vehicles["r1"]
        vehicle.scramble(share, ways)
        if ways == "out":  # nobody needs to know before the base is to do otherwise
            vehicle.pilot = None
            vehicle.bot.command(rig.now, rig.now, 0.0, 0.0)

    return act


_LINE: Final = tuple(
    SensorFault(
        "line to the base",
        f"{share:.0%} noise, {ways}",
        _noise(share, ways),
        AT_ONCE if share <= 0.3 and ways != "out" else None,
    )
    for share in (0.05, 0.1, 0.3, 0.6)
    for ways in ("both", "in", "out")
)
FAULTS: Final = (
    SensorFault("lidar", "repeats one turn", _lidar(Lie(turns=1)), AT_ONCE),
    SensorFault("lidar", "repeats 5 turns", _lidar(Lie(turns=5)), AT_ONCE),
    SensorFault("lidar", "half of each turn repeated", _lidar(Lie(turns=1, share=0.5)), AT_ONCE),
    SensorFault("lidar", "every other beam repeated", _lidar(Lie(turns=1, comb=True))),
    SensorFault("lidar", "one turn, with fresh noise", _lidar(Lie(turns=1, noisy=True))),
    SensorFault("lidar", "turned by 90°", _lidar(Lie(turned_deg=90.0))),
    SensorFault(
        "lidar", "turned by 90°, from the start", _lidar(Lie(turned_deg=90.0)), AT_THE_START, from_start=True
    ),
    SensorFault("lidar", "turned by -45°", _lidar(Lie(turned_deg=-45.0))),
    SensorFault("lidar", "turned by 180°", _lidar(Lie(turned_deg=180.0))),
    SensorFault("lidar", "mirrored", _lidar(Lie(mirrored=True)), bends=True),
    SensorFault("lidar", "1 s late, from the start", _lidar(Lie(late_s=1.0)), AT_THE_START, from_start=True),
    SensorFault("both encoders", "stand still", _base(left_scale=0.0, right_scale=0.0)),
    SensorFault("both encoders", "count double", _base(left_scale=2.0, right_scale=2.0)),
    SensorFault("both encoders", "count backward", _base(left_scale=-1.0, right_scale=-1.0)),
    SensorFault("left encoder", "stands still", _base(left_scale=0.0)),
    SensorFault("right encoder", "stands still", _base(right_scale=0.0)),
    SensorFault("left encoder", "counts double", _base(left_scale=2.0)),
    SensorFault("right encoder", "counts backward", _base(right_scale=-1.0)),
    SensorFault("gyro", "turns at 0.5 rad/s for ever", _base(gyro_drift=0.5)),
    SensorFault("gyro", "stands still", _base(gyro="frozen"), bends=True),
    SensorFault("gyro", "sign reversed", _base(gyro_scale=-1.0), bends=True),
    SensorFault("gyro", "says double", _base(gyro_scale=2.0), bends=True),
    SensorFault("base's clock", "stands still", _base(stamp="frozen"), AT_ONCE),
    SensorFault("base's clock", "goes backward", _base(stamp="backward"), AT_ONCE),
    SensorFault("base's clock", "jumps", _base(stamp="jumping"), AT_ONCE),
    *_LINE,
)
