"""Where the transceivers are during one step, and which of them are on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.messages import RobotTruth
from actors.portable.compiled import cos, sin

Floats = NDArray[np.float64]


class TransceiverTruth:
    """What is true of the transceivers in one step, by number; one whose robot is gone is switched off.

    A robot moves on from its pose at the step's start with constant speed and angular velocity: along an arc.
    """

    def __init__(self, start_us: int, robots: Sequence[RobotTruth | None]) -> None:
        self._start_ns = start_us * 1000
        # Lists, not generators: a call less for each robot.
        self.powered = tuple([robot is not None and robot.powered for robot in robots])
        self.epochs = tuple([robot.epoch if robot is not None else 0 for robot in robots])
        truths = [(r.x, r.y, r.vx, r.vy, r.omega) if r else (0.0, 0.0, 0.0, 0.0, 0.0) for r in robots]
        table = np.array(truths, dtype=np.float64).reshape(-1, 5)
        self.places: Floats = table[:, :2].copy()
        """(transceivers, 2), m, at the step's start."""
        self._truths = table
        self.still = not table[:, 2:4].any()

    def positions(self, instant_ns: int) -> NDArray[np.float64]:
        """Positions at the instant: (transceivers, 2), m."""
        elapsed = (instant_ns - self._start_ns) / 1e9
        moved: Floats = _moved(self._truths, elapsed)
        return moved


@njit(cache=True)  # type: ignore[untyped-decorator]
def _moved(truths: Floats, elapsed: float) -> Floats:
    """Places, (n, 2) m, after so many seconds: truths (n, 5), place, m, velocity, m/s, its turning, rad/s."""
    moved = np.empty((truths.shape[0], 2))
    for i in range(truths.shape[0]):
        x, y, omega = truths[i, 0], truths[i, 1], truths[i, 4]
        vx, vy = truths[i, 2], truths[i, 3]
        half_angle = omega * (elapsed / 2)
        cosine, sine = cos(half_angle), sin(half_angle)
        # the chord of an arc: as long as sin(h)/h of the way driven, turned by the half angle h
        driven = elapsed * (sine / half_angle if half_angle != 0 else 1.0)
        cosine, sine = driven * cosine, driven * sine
        moved[i, 0] = x + (vx * cosine - vy * sine)
        moved[i, 1] = y + (vx * sine + vy * cosine)
    return moved


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    robots = [
        RobotTruth(
            id=f"r{k}",
            x=0.3 * k,
            y=2.0 - k,
            heading=0.0,
            vx=0.1 * k,
            vy=0.4,
            omega=0.2 * k - 0.4,
            stepping=True,
            powered=True,
            transmits=0,
        )
        for k in range(5)
    ]
    return TransceiverTruth(0, robots).positions(73_000_001).tobytes()
