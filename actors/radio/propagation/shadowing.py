"""What furniture and people make of a link: a random loss that changes as either end moves.

For one moving end Gudmundson, "Correlation model for shadow fading in mobile radio systems", Electronics
Letters 27(23), 1991: exp(-moved / correlation distance). With both ends moving the correlation is the
product of both (Wang, Tameh and Nix, "Joint Shadowing Process in Urban Peer-to-Peer Radio Channels", IEEE
Transactions on Vehicular Technology 57(1), 2008), and as there it is made of sinusoids over the four
coordinates: here with random wave vectors from the bivariate Cauchy distribution, whose characteristic
function is that very exponential (Rahimi and Recht, "Random Features for Large-Scale Kernel Machines",
NIPS 2007). So the loss is a function of the two places and the seed, whoever else there is.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import cos, exp, sin
from actors.portable.draws import normals, uniforms

Floats = NDArray[np.float64]
NOWHERE: Final = -(2**62)
"""A square's number for what has no phasors yet."""


@dataclass(frozen=True)
class ShadowingParameters:
    """How much two links of the same length differ, and over which distances."""

    sigma_db: float = 0.0
    """Standard deviation, dB; 0: none. About 3 in line of sight, 7 to 14 through a building (Rappaport,
    "Wireless Communications", table 4.6)."""
    correlation_distance: float = 2.0
    """One end's way, m, after which the correlation has fallen to 1/e. Default: own choice, of the order that
    indoor measurements give, 1 to 3 m."""
    sinusoids: int = 64
    """How many make up the field. Default: own choice; the kurtosis falls short of the normal
    distribution's by 1.5 / 64."""
    grain: float = 0.05
    """Side of the squares, m, in which a place counts as their middle, so that a robot that stands or creeps
    needs no new sines. Default: own choice; the step from one to the next is about 1/4 sigma."""


@dataclass(frozen=True, eq=False)
class Waves:
    """The sinusoids of one seed; made by `waves`."""

    first: Floats
    """(sinusoids, 2): wave vector of the one end, rad/m."""
    second: Floats
    """(sinusoids, 2): that of the other end, rad/m."""
    phase: Floats
    """(sinusoids,): rad."""


def waves(parameters: ShadowingParameters, rng: Generator) -> Waves:
    """Draw the sinusoids."""
    n = parameters.sinusoids
    vectors = normals(rng, (2, n, 2)) / np.abs(normals(rng, (2, n, 1)))
    first, second = vectors / parameters.correlation_distance
    return Waves(first, second, uniforms(rng, -math.pi, math.pi, n))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _phasors(
    column: int, row: int, grain: float, first: Floats, second: Floats, phase: Floats, phasors: Floats
) -> None:
    """The phasors, (4, sinusoids), of a square: as the first end, and as the second."""
    x, y = (column + 0.5) * grain, (row + 0.5) * grain
    for k in range(phase.size):
        one = first[k, 0] * x + first[k, 1] * y + phase[k]
        other = second[k, 0] * x + second[k, 1] * y
        phasors[0, k], phasors[1, k] = cos(one), sin(one)
        phasors[2, k], phasors[3, k] = cos(other), sin(other)


@njit(cache=True)  # type: ignore[untyped-decorator]
def refresh(
    places: Floats,
    grain: float,
    first: Floats,
    second: Floats,
    phase: Floats,
    cells: NDArray[np.int64],
    phasors: Floats,
) -> None:
    """Bring the phasors, (4, sinusoids, n), of those who have come into another square up to date.

    places (n, 2), m; cells (n, 2): the squares that the phasors are of, written.
    """
    for j in range(places.shape[0]):
        column, row = math.floor(places[j, 0] / grain), math.floor(places[j, 1] / grain)
        if cells[j, 0] != column or cells[j, 1] != row:
            cells[j, 0], cells[j, 1] = column, row
            _phasors(column, row, grain, first, second, phase, phasors[:, :, j])


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_shadowing(
    senders: Floats,
    receivers: Floats,
    sigma_db: float,
    correlation_distance: float,
    grain: float,
    first: Floats,
    second: Floats,
    phase: Floats,
    cells: NDArray[np.int64],
    phasors: Floats,
    loss_db: Floats,
) -> None:
    """Add the shadowing between each sender, (s, 2) m, and each receiver, (r, 2) m, to loss_db, (s, r) dB.

    cells, phasors: of the receivers, see `refresh`. The field F(p, q) is made symmetric: (F(p, q) + F(q, p))
    / sqrt(2 + 2 exp(-2 |p - q| / correlation distance)), which has the same variance everywhere.
    """
    n = receivers.shape[0]
    own = np.empty((4, phase.size))
    total = np.empty(n)
    for i in range(senders.shape[0]):
        column, row = math.floor(senders[i, 0] / grain), math.floor(senders[i, 1] / grain)
        known = -1
        for j in range(n):
            if cells[j, 0] == column and cells[j, 1] == row:
                known = j
        if known >= 0:
            for end in range(4):  # not as one slice: its message of sizes that differ compiles for seconds
                for k in range(phase.size):
                    own[end, k] = phasors[end, k, known]
        else:
            _phasors(column, row, grain, first, second, phase, own)
        total[:] = 0.0
        for k in range(phase.size):
            a, b, c, d = own[0, k], own[1, k], own[2, k], own[3, k]
            for j in range(n):  # in this order for the processor's vectors, which must not change the sums
                there = a * phasors[2, k, j] - b * phasors[3, k, j]
                back = c * phasors[0, k, j] - d * phasors[1, k, j]
                total[j] += there + back
        for j in range(n):
            dx, dy = column - cells[j, 0], row - cells[j, 1]
            apart = grain * math.sqrt(dx * dx + dy * dy)
            alike = exp(-2.0 * apart / correlation_distance)
            loss_db[i, j] += sigma_db * total[j] / math.sqrt(phase.size * (1.0 + alike))
