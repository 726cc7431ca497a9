"""How much of a signal gets from one place to another: distance, walls and shadowing together.

Path loss is log-distance with one or two slopes.
`loss = excess + near_loss + 10 near_exponent log10 d` up to the breakpoint, and beyond it `excess + far_loss
+ 10 far_exponent log10(d / breakpoint)`. Two slopes are those of IEEE 802.15.4-2006, Annex E; with the
breakpoint at infinity it is the plain log-distance model (Rappaport, "Wireless Communications", 4.9.1).

Shadowing is a random loss that changes as either end moves.
For one moving end Gudmundson, "Correlation model for shadow fading in mobile radio systems", Electronics
Letters 27(23), 1991: exp(-moved / correlation distance). With both ends moving the correlation is the
product of both (Wang, Tameh and Nix, "Joint Shadowing Process in Urban Peer-to-Peer Radio Channels", IEEE
Transactions on Vehicular Technology 57(1), 2008), and as there it is made of sinusoids over the four
coordinates: here with random wave vectors from the bivariate Cauchy distribution, whose characteristic
function is that very exponential (Rahimi and Recht, "Random Features for Large-Scale Kernel Machines",
NIPS 2007). So the loss depends only on the two positions and the seed.
"""

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable import arrays
from actors.portable.compiled import cos, exp, exp10, log10, sin
from actors.portable.draws import normals, uniforms
from actors.radio.walls import TILE, Walls, between, walls_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PathLossParameters:
    """Loss over distance in line of sight; the defaults are Annex E."""

    near_loss_db: float = 40.2
    """At 1 m, dB. Default: IEEE 802.15.4-2006, Annex E (free space at 2.45 GHz)."""
    near_exponent: float = 2.0
    """Up to the breakpoint. Default: Annex E (free space)."""
    breakpoint: float = 8.0
    """Where the second slope begins, m; `inf`: nowhere. Default: Annex E."""
    far_loss_db: float = 58.5
    """Just beyond the breakpoint, dB. Default: Annex E."""
    far_exponent: float = 3.3
    """Beyond the breakpoint. Default: Annex E."""
    excess_db: float = 0.0
    """What antennas, their housing and their height above the floor cost beyond that, dB, at any distance."""
    nearest: float = 0.1
    """Antennas are never taken to be closer than this, m. Default: about the wavelength, 0.12 m, where the
    far-field formula ends."""

    def coefficients(self) -> Floats:
        """What the kernels take: near loss and slope, breakpoint, far loss and slope per decade, nearest."""
        far = 10.0 * self.far_exponent
        far_at_one = self.far_loss_db - (0.0 if math.isinf(self.breakpoint) else far * log10(self.breakpoint))
        near_at_one, far_at_one = self.excess_db + self.near_loss_db, self.excess_db + far_at_one
        near = 10.0 * self.near_exponent
        return np.array([near_at_one, near, self.breakpoint, far_at_one, far, self.nearest])


@njit(cache=True)  # type: ignore[untyped-decorator]
def over(distance: float, coefficients: Floats) -> float:
    """The loss, dB, over a distance, m."""
    d = max(distance, coefficients[5])
    if d <= coefficients[2]:
        near: float = coefficients[0] + coefficients[1] * log10(d)
        return near
    far: float = coefficients[3] + coefficients[4] * log10(d)
    return far


def line_of_sight(budget_db: float, parameters: PathLossParameters) -> float:
    """The greatest distance, m, over which the loss in line of sight is within the budget, dB; 0: none."""
    p = parameters
    budget_db -= p.excess_db
    if budget_db >= p.far_loss_db and not math.isinf(p.breakpoint):
        return float(p.breakpoint * exp10((budget_db - p.far_loss_db) / (10.0 * p.far_exponent)))
    if p.near_exponent == 0.0:
        return p.breakpoint if budget_db >= p.near_loss_db else 0.0
    distance = min(exp10((budget_db - p.near_loss_db) / (10.0 * p.near_exponent)), p.breakpoint)
    return float(distance) if distance >= p.nearest else 0.0


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


class ShadowingWaves(NamedTuple):
    """The sinusoids of one seed; made by `waves`."""

    first: Floats
    """(sinusoids, 2): wave vector of the one end, rad/m."""
    second: Floats
    """(sinusoids, 2): that of the other end, rad/m."""
    phase: Floats
    """(sinusoids,): rad."""


def waves(parameters: ShadowingParameters, rng: Generator) -> ShadowingWaves:
    """Draw the sinusoids."""
    n = parameters.sinusoids
    vectors = normals(rng, (2, n, 2)) / np.abs(normals(rng, (2, n, 1)))
    first, second = vectors / parameters.correlation_distance
    return ShadowingWaves(first, second, uniforms(rng, -math.pi, math.pi, n))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _phasors(column: int, row: int, grain: float, waves: ShadowingWaves, phasors: Floats) -> None:
    """Write the phasors, (4, sinusoids), of a square: as the first end, and as the second."""
    first, second, phase = waves
    x, y = (column + 0.5) * grain, (row + 0.5) * grain
    for k in range(phase.size):
        one = first[k, 0] * x + first[k, 1] * y + phase[k]
        other = second[k, 0] * x + second[k, 1] * y
        phasors[0, k], phasors[1, k] = cos(one), sin(one)
        phasors[2, k], phasors[3, k] = cos(other), sin(other)


@njit(cache=True)  # type: ignore[untyped-decorator]
def refresh(
    places: Floats, grain: float, waves: ShadowingWaves, cells: NDArray[np.int64], phasors: Floats
) -> None:
    """Bring the phasors, (4, sinusoids, n), of those who have come into another square up to date.

    places (n, 2), m; cells (n, 2): the squares that the phasors are of, written.
    """
    for j in range(places.shape[0]):
        column, row = math.floor(places[j, 0] / grain), math.floor(places[j, 1] / grain)
        if cells[j, 0] != column or cells[j, 1] != row:
            cells[j, 0], cells[j, 1] = column, row
            _phasors(column, row, grain, waves, phasors[:, :, j])


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_shadowing(
    senders: Floats,
    receivers: Floats,
    sigma_db: float,
    correlation_distance: float,
    grain: float,
    waves: ShadowingWaves,
    cells: NDArray[np.int64],
    phasors: Floats,
    loss_db: Floats,
) -> None:
    """Add the shadowing between each sender, (s, 2) m, and each receiver, (r, 2) m, to loss_db, (s, r) dB.

    cells, phasors: of the receivers, see `refresh`. The field F(p, q) is made symmetric: (F(p, q) + F(q, p))
    / sqrt(2 + 2 exp(-2 |p - q| / correlation distance)), which has the same variance everywhere.
    """
    n, sinusoids = receivers.shape[0], waves.phase.size
    own = np.empty((4, sinusoids))
    total = np.empty(n)
    for i in range(senders.shape[0]):
        column, row = math.floor(senders[i, 0] / grain), math.floor(senders[i, 1] / grain)
        known = -1
        for j in range(n):
            if cells[j, 0] == column and cells[j, 1] == row:
                known = j
        if known >= 0:
            for end in range(4):  # not as one slice: its message of sizes that differ compiles for seconds
                for k in range(sinusoids):
                    own[end, k] = phasors[end, k, known]
        else:
            _phasors(column, row, grain, waves, own)
        total[:] = 0.0
        for k in range(sinusoids):
            a, b, c, d = own[0, k], own[1, k], own[2, k], own[3, k]
            for j in range(n):  # in this order for the processor's vectors, which must not change the sums
                there = a * phasors[2, k, j] - b * phasors[3, k, j]
                back = c * phasors[0, k, j] - d * phasors[1, k, j]
                total[j] += there + back
        for j in range(n):
            dx, dy = column - cells[j, 0], row - cells[j, 1]
            apart = grain * math.sqrt(dx * dx + dy * dy)
            alike = exp(-2.0 * apart / correlation_distance)
            loss_db[i, j] += sigma_db * total[j] / math.sqrt(sinusoids * (1.0 + alike))


_ROUNDING_DB: Final = 1e-9
"""More than sums in another order can differ by."""


@dataclass(frozen=True)
class PropagationParameters:
    """What lies between two antennas."""

    path_loss: PathLossParameters = field(default_factory=PathLossParameters)
    """Over distance, in line of sight."""
    walls: str = "air"
    """Material of what the floor plan has as occupied (`walls.MATERIALS`); "air": walls cost nothing."""
    shadowing: ShadowingParameters = field(default_factory=ShadowingParameters)
    """Random differences between places."""


class IndoorPropagation:
    """A `medium.Propagation`: path loss, the walls of a floor plan, shadowing.

    The loss depends on the two places and on the draws at construction alone, is the same in both directions,
    to the last bit, and never below 0 dB.
    """

    def __init__(
        self, parameters: PropagationParameters, floor: Walls | None = None, rng: Generator | None = None
    ) -> None:
        self._coefficients = parameters.path_loss.coefficients()
        self._floor = floor if floor is not None and (floor.crossing_db + floor.per_metre_db).any() else None
        self._shadowing = parameters.shadowing
        self._waves: ShadowingWaves | None = None
        if parameters.shadowing.sigma_db > 0:
            assert rng is not None, "shadowing is drawn"
            self._waves = waves(parameters.shadowing, rng)
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
            _losses(senders, receivers, self._coefficients, floor, most_db, loss)
        return loss

    def _add_shadowing(self, waves: ShadowingWaves, senders: Floats, receivers: Floats, loss: Floats) -> None:
        """Phasors are kept by row of `receivers`: those who have not moved need none anew."""
        p = self._shadowing
        if len(self._cells) != len(receivers):
            self._cells = np.full((len(receivers), 2), NOWHERE, np.int64)
            self._phasors = np.empty((4, p.sinusoids, len(receivers)))
        kept = p.grain, waves, self._cells, self._phasors
        refresh(receivers, *kept)
        add_shadowing(senders, receivers, p.sigma_db, p.correlation_distance, *kept, loss)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _over(senders: Floats, i: int, receivers: Floats, j: int, coefficients: Floats) -> float:
    dx, dy = receivers[j, 0] - senders[i, 0], receivers[j, 1] - senders[i, 1]
    loss: float = max(over(np.sqrt(dx * dx + dy * dy), coefficients), 0.0)
    return loss


@njit(cache=True)  # type: ignore[untyped-decorator]
def _path_losses(senders: Floats, receivers: Floats, coefficients: Floats, loss_db: Floats) -> None:
    """Add the loss by distance to loss_db, (s, r) dB; 0 at least."""
    for i in range(senders.shape[0]):
        for j in range(receivers.shape[0]):
            loss_db[i, j] = max(_over(senders, i, receivers, j, coefficients) + loss_db[i, j], 0.0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _losses(
    senders: Floats, receivers: Floats, coefficients: Floats, floor: Walls, most_db: float, loss_db: Floats
) -> None:
    """Add the loss by distance and walls to loss_db, (s, r) dB; 0 at least.

    What comes to more than most_db may be any value above it.
    """
    side, west, south = TILE * floor.resolution, floor.west, floor.south
    per_tile_db = floor.per_metre_db * side
    for i in range(senders.shape[0]):
        x, y = (senders[i, 0] - west) / side, (senders[i, 1] - south) / side
        for j in range(receivers.shape[0]):
            loss = _over(senders, i, receivers, j, coefficients)
            left_db = most_db - (loss + loss_db[i, j])
            if left_db >= 0.0:
                to_x, to_y = (receivers[j, 0] - west) / side, (receivers[j, 1] - south) / side
                loss += between(floor, per_tile_db, x, y, to_x, to_y, left_db + _ROUNDING_DB)
            loss_db[i, j] = max(loss + loss_db[i, j], 0.0)


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    kinds = (arrays.sin(np.square(np.arange(1200.0))).reshape(30, 40) > 0.8).astype(np.uint8)
    floor = walls_of(kinds, 0.05, -0.2, 0.1, np.array([0.0, 1.0]), np.array([0.0, 22.7]))
    places = np.stack([arrays.cos(np.arange(7.0)), 0.85 + 0.8 * arrays.sin(np.arange(7.0))], axis=1)
    parameters = PropagationParameters(shadowing=ShadowingParameters(4.0))
    propagation = IndoorPropagation(parameters, floor, np.random.default_rng(1))
    tiles = floor.leaps, floor.begins, floor.blocks
    return b"".join(part.tobytes() for part in tiles) + propagation.loss_db(places, places).tobytes()
