"""How much of a signal gets from one place to another: distance, walls and shadowing together."""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable import arrays
from actors.radio.propagation import path_loss, shadowing, walls
from actors.radio.propagation.path_loss import PathLossParameters
from actors.radio.propagation.shadowing import ShadowingParameters, Waves
from actors.radio.propagation.tiles import TILE, tiles_of
from actors.radio.propagation.walls import Walls

Floats = NDArray[np.float64]
_ROUNDING_DB: Final = 1e-9
"""More than sums in another order can differ by."""


@dataclass(frozen=True)
class PropagationParameters:
    """What lies between two antennas."""

    path_loss: PathLossParameters = field(default_factory=PathLossParameters)
    """Over distance, in line of sight."""
    walls: str = "air"
    """Material of what the floor plan has as occupied (`materials.MATERIALS`); "air": walls cost nothing."""
    shadowing: ShadowingParameters = field(default_factory=ShadowingParameters)
    """Random differences between places."""


class IndoorPropagation:
    """A `channel.Propagation`: path loss, the walls of a floor plan, shadowing.

    The loss depends on the two places and on the draws at construction alone, is the same in both directions,
    to the last bit, and never below 0 dB.
    """

    def __init__(
        self, parameters: PropagationParameters, floor: Walls | None = None, rng: Generator | None = None
    ) -> None:
        self._coefficients = parameters.path_loss.coefficients()
        self._floor = floor if floor is not None and (floor.crossing_db + floor.per_metre_db).any() else None
        self._shadowing = parameters.shadowing
        self._waves: Waves | None = None
        if parameters.shadowing.sigma_db > 0:
            assert rng is not None, "shadowing is drawn"
            self._waves = shadowing.waves(parameters.shadowing, rng)
        self._cells: NDArray[np.int64] = np.empty((0, 2), np.int64)
        self._phasors: Floats = np.empty((4, parameters.shadowing.sinusoids, 0))

    def loss_db(self, senders: Floats, receivers: Floats, most_db: float = math.inf) -> Floats:
        """Loss between each sender, (s, 2) m, and each receiver, (r, 2) m: (s, r) dB.

        A loss above `most_db` may be any value above it: behind so many walls the rest is not looked at.
        """
        if not (senders.flags.carray and receivers.flags.carray):  # one kind of array for the kernels
            senders, receivers = np.array(senders), np.array(receivers)
        loss = np.zeros((senders.shape[0], receivers.shape[0]))
        if self._waves is not None:  # first: no line is followed to where shadowing takes the frame away
            self._add_shadowing(self._waves, senders, receivers, loss)
        floor = self._floor
        if floor is None:
            _path_losses(senders, receivers, self._coefficients, loss)
        else:
            _losses(
                senders, receivers, self._coefficients, *floor.tiles,
                floor.resolution, floor.west, floor.south, floor.crossing_db, floor.per_metre_db,
                most_db, loss,
            )  # fmt: skip
        return loss

    def _add_shadowing(self, waves: Waves, senders: Floats, receivers: Floats, loss: Floats) -> None:
        """Phasors are kept by row of `receivers`: those who have not moved need none anew."""
        p = self._shadowing
        if len(self._cells) != len(receivers):
            self._cells = np.full((len(receivers), 2), shadowing.NOWHERE, np.int64)
            self._phasors = np.empty((4, p.sinusoids, len(receivers)))
        shadowing.refresh(
            receivers, p.grain, waves.first, waves.second, waves.phase, self._cells, self._phasors
        )
        shadowing.add_shadowing(
            senders, receivers, p.sigma_db, p.correlation_distance, p.grain,
            waves.first, waves.second, waves.phase, self._cells, self._phasors, loss,
        )  # fmt: skip


@njit(cache=True)  # type: ignore[untyped-decorator]
def _over(senders: Floats, i: int, receivers: Floats, j: int, coefficients: Floats) -> float:
    dx, dy = receivers[j, 0] - senders[i, 0], receivers[j, 1] - senders[i, 1]
    loss: float = max(path_loss.over(np.sqrt(dx * dx + dy * dy), coefficients), 0.0)
    return loss


@njit(cache=True)  # type: ignore[untyped-decorator]
def _path_losses(senders: Floats, receivers: Floats, coefficients: Floats, loss_db: Floats) -> None:
    """Add the loss by distance to loss_db, (s, r) dB; 0 at least."""
    for i in range(senders.shape[0]):
        for j in range(receivers.shape[0]):
            loss_db[i, j] = max(_over(senders, i, receivers, j, coefficients) + loss_db[i, j], 0.0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _losses(
    senders: Floats,
    receivers: Floats,
    coefficients: Floats,
    leaps: NDArray[np.uint8],
    begins: NDArray[np.int32],
    blocks: NDArray[np.uint8],
    resolution: float,
    west: float,
    south: float,
    crossing_db: Floats,
    per_metre_db: Floats,
    most_db: float,
    loss_db: Floats,
) -> None:
    """Add the loss by distance and walls to loss_db, (s, r) dB; 0 at least.

    What comes to more than most_db may be any value above it.
    """
    side = TILE * resolution
    per_tile_db = per_metre_db * side
    for i in range(senders.shape[0]):
        x, y = (senders[i, 0] - west) / side, (senders[i, 1] - south) / side
        for j in range(receivers.shape[0]):
            loss = _over(senders, i, receivers, j, coefficients)
            left_db = most_db - (loss + loss_db[i, j])
            if left_db >= 0.0:
                loss += walls.between(
                    leaps, begins, blocks, crossing_db, per_tile_db, x, y,
                    (receivers[j, 0] - west) / side, (receivers[j, 1] - south) / side, left_db + _ROUNDING_DB,
                )  # fmt: skip
            loss_db[i, j] = max(loss + loss_db[i, j], 0.0)


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    kinds = (arrays.sin(np.square(np.arange(1200.0))).reshape(30, 40) > 0.8).astype(np.uint8)
    floor = Walls(tiles_of(kinds), 0.05, -0.2, 0.1, np.array([0.0, 1.0]), np.array([0.0, 22.7]))
    places = np.stack([arrays.cos(np.arange(7.0)), 0.85 + 0.8 * arrays.sin(np.arange(7.0))], axis=1)
    parameters = PropagationParameters(shadowing=ShadowingParameters(4.0))
    propagation = IndoorPropagation(parameters, floor, np.random.default_rng(1))
    return b"".join(part.tobytes() for part in floor.tiles) + propagation.loss_db(places, places).tobytes()
