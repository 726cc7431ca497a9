"""Loss of signals between two places: path loss, walls and shadowing.

Path loss is log-distance with one or two slopes: `loss = excess + near_loss + 10 near_exponent log10 d` up to
the breakpoint, and beyond it `excess + far_loss + 10 far_exponent log10(d / breakpoint)`. Two slopes are
those of IEEE 802.15.4-2006, Annex E; with the breakpoint at infinity it is the plain log-distance model
(Rappaport, "Wireless Communications", 4.9.1).

Shadowing is a random loss that changes as either end moves. For one moving end, its correlation is that of
Gudmundson, "Correlation model for shadow fading in mobile radio systems", Electronics Letters 27(23), 1991:
exp(-moved / correlation distance). With both ends moving it is the product of both (Wang, Tameh and Nix,
"Joint Shadowing Process in Urban Peer-to-Peer Radio Channels", IEEE Transactions on Vehicular Technology
57(1), 2008). As there, it is a sum of sinusoids over the four coordinates, here with random wave vectors from
the bivariate Cauchy distribution, whose characteristic function is this exponential (Rahimi and Recht,
"Random Features for Large-Scale Kernel Machines", NIPS 2007). So the loss depends only on the two positions
and the seed.
"""

import math
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Floats, Int64s
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import cos, exp, exp10, log10, sin
from actors.portable.draws import normals, uniforms
from actors.radio.walls import TILE, Walls, wall_loss, walls_of


class PathLossParameters(msgspec.Struct, frozen=True):
    """Path loss in line of sight; the defaults are those of Annex E."""

    near_loss_db: float = 40.2
    """Loss at 1 m, dB. Default: IEEE 802.15.4-2006, Annex E (free space at 2.45 GHz)."""
    near_exponent: float = 2.0
    """Exponent up to the breakpoint. Default: Annex E (free space)."""
    breakpoint: float = 8.0
    """Distance at which the second slope begins, m; `inf`: none. Default: Annex E."""
    far_loss_db: float = 58.5
    """Loss just beyond the breakpoint, dB. Default: Annex E."""
    far_exponent: float = 3.3
    """Exponent beyond the breakpoint. Default: Annex E."""
    excess_db: float = 0.0
    """Additional loss at any distance, dB, of antennas, their housing and their height above the floor."""
    nearest: float = 0.1
    """Minimum distance used, m. Default: about the wavelength, 0.12 m, below which the far-field formula does
    not hold."""

    def coefficients(self) -> Floats:
        """Return the kernels' coefficients: near loss and slope, breakpoint, far loss and slope per decade,
        nearest."""
        far = 10.0 * self.far_exponent
        far_at_one = self.far_loss_db - (0.0 if math.isinf(self.breakpoint) else far * log10(self.breakpoint))
        near_at_one, far_at_one = self.excess_db + self.near_loss_db, self.excess_db + far_at_one
        near = 10.0 * self.near_exponent
        return np.array([near_at_one, near, self.breakpoint, far_at_one, far, self.nearest])


@kernel
def path_loss(distance: float, coefficients: Floats) -> float:
    """Return the loss, dB, over a distance, m."""
    d = max(distance, coefficients[5])
    if d <= coefficients[2]:
        near: float = coefficients[0] + coefficients[1] * log10(d)
        return near
    far: float = coefficients[3] + coefficients[4] * log10(d)
    return far


def line_of_sight(budget_db: float, parameters: PathLossParameters) -> float:
    """Return the greatest line-of-sight distance, m, with a loss within the budget, dB; 0: none."""
    p = parameters
    budget_db -= p.excess_db
    if budget_db >= p.far_loss_db and not math.isinf(p.breakpoint):
        return float(p.breakpoint * exp10((budget_db - p.far_loss_db) / (10.0 * p.far_exponent)))
    if p.near_exponent == 0.0:
        return p.breakpoint if budget_db >= p.near_loss_db else 0.0
    distance = min(exp10((budget_db - p.near_loss_db) / (10.0 * p.near_exponent)), p.breakpoint)
    return float(distance) if distance >= p.nearest else 0.0


NO_SQUARE: Final = -(2**62)
"""Square number of receivers without phasors."""


class ShadowingParameters(msgspec.Struct, frozen=True):
    """Parameters of random differences between links of equal length."""

    sigma_db: float = 0.0
    """Standard deviation, dB; 0: none. About 3 in line of sight, 7 to 14 through a building (Rappaport,
    "Wireless Communications", table 4.6)."""
    correlation_distance: float = 2.0
    """Displacement of one end, m, at which the correlation has fallen to 1/e. Default: own choice, within the
    1 to 3 m of indoor measurements."""
    sinusoids: int = 64
    """Number of sinusoids in the field. Default: own choice; the kurtosis is lower than the normal
    distribution's by 1.5 / 64."""
    grain: float = 0.05
    """Side of the squares, m, within which all places count as the centre, so that standing or slow robots
    need no new sines. Default: own choice; the step between neighbours is about 1/4 sigma."""


class ShadowingWaves(NamedTuple):
    """Sinusoids of one seed, made by `waves`."""

    first: Floats
    """Wave vectors of one end, (sinusoids, 2), rad/m."""
    second: Floats
    """Wave vectors of the other end, (sinusoids, 2), rad/m."""
    phase: Floats
    """Phases, (sinusoids,), rad."""


def waves(parameters: ShadowingParameters, rng: Generator) -> ShadowingWaves:
    """Draw the sinusoids."""
    n = parameters.sinusoids
    vectors = normals(rng, (2, n, 2)) / np.abs(normals(rng, (2, n, 1)))
    first, second = vectors / parameters.correlation_distance
    return ShadowingWaves(first, second, uniforms(rng, -math.pi, math.pi, n))


@kernel
def _phasors(column: int, row: int, grain: float, waves: ShadowingWaves, phasors: Floats) -> None:
    """Write the phasors, (4, sinusoids), of a square: as the first end, and as the second."""
    first, second, phase = waves
    x, y = (column + 0.5) * grain, (row + 0.5) * grain
    for k in range(phase.size):
        one = first[k, 0] * x + first[k, 1] * y + phase[k]
        other = second[k, 0] * x + second[k, 1] * y
        phasors[0, k], phasors[1, k] = cos(one), sin(one)
        phasors[2, k], phasors[3, k] = cos(other), sin(other)


@kernel
def refresh(places: Floats, grain: float, waves: ShadowingWaves, cells: Int64s, phasors: Floats) -> None:
    """Update the phasors, (4, sinusoids, n), of receivers that have entered another square.

    places (n, 2), m; cells (n, 2): squares of the phasors, written.
    """
    for j in range(places.shape[0]):
        column, row = math.floor(places[j, 0] / grain), math.floor(places[j, 1] / grain)
        if cells[j, 0] != column or cells[j, 1] != row:
            cells[j, 0], cells[j, 1] = column, row
            _phasors(column, row, grain, waves, phasors[:, :, j])


@kernel
def add_shadowing(
    senders: Floats,
    receivers: Floats,
    sigma_db: float,
    correlation_distance: float,
    grain: float,
    waves: ShadowingWaves,
    cells: Int64s,
    phasors: Floats,
    loss_db: Floats,
) -> None:
    """Add the shadowing between each sender, (s, 2) m, and each receiver, (r, 2) m, to loss_db, (s, r) dB.

    cells, phasors: of the receivers, see `refresh`. The field F(p, q) is made symmetric:
    ``(F(p, q) + F(q, p)) / sqrt(2 + 2 exp(-2 |p - q| / correlation distance))``, with the same variance
    everywhere.
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
            for end in range(4):  # not a slice: its size-mismatch error takes seconds to compile
                for k in range(sinusoids):
                    own[end, k] = phasors[end, k, known]
        else:
            _phasors(column, row, grain, waves, own)
        total[:] = 0.0
        for k in range(sinusoids):
            a, b, c, d = own[0, k], own[1, k], own[2, k], own[3, k]
            for j in range(n):  # this order can be vectorised without changing the sums
                there = a * phasors[2, k, j] - b * phasors[3, k, j]
                back = c * phasors[0, k, j] - d * phasors[1, k, j]
                total[j] += there + back
        for j in range(n):
            dx, dy = column - cells[j, 0], row - cells[j, 1]
            apart = grain * math.sqrt(dx * dx + dy * dy)
            correlation = exp(-2.0 * apart / correlation_distance)
            loss_db[i, j] += sigma_db * total[j] / math.sqrt(sinusoids * (1.0 + correlation))


_ROUNDING_DB: Final = 1e-9
"""More than the rounding differences of sums in another order."""


class PropagationParameters(msgspec.Struct, frozen=True):
    """Parameters of the loss between two antennas."""

    path_loss: PathLossParameters = msgspec.field(default_factory=PathLossParameters)
    """Path loss over distance in line of sight."""
    walls: str = "air"
    """Material of occupied cells (`walls.MATERIALS`); "air": no loss by walls."""
    shadowing: ShadowingParameters = msgspec.field(default_factory=ShadowingParameters)
    """Random differences between places."""


class IndoorPropagation:
    """A `medium.Propagation` with path loss, walls of a floor plan and shadowing.

    The loss depends only on the two places and on the draws at construction, is bit-equal in both directions,
    and is never below 0 dB.
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
        self._cells: Int64s = np.empty((0, 2), np.int64)
        self._phasors: Floats = np.empty((4, parameters.shadowing.sinusoids, 0))

    def loss_db(self, senders: Floats, receivers: Floats, most_db: float = math.inf) -> Floats:
        """Return the loss between each sender, (s, 2) m, and each receiver, (r, 2) m: (s, r) dB.

        A loss above `most_db` may be any value above it: further walls are not evaluated.
        """
        if not (
            senders.flags.carray and receivers.flags.carray
        ):  # kernels are compiled for one kind of array
            senders, receivers = np.array(senders), np.array(receivers)
        loss = np.zeros((senders.shape[0], receivers.shape[0]))
        if self._waves is not None:  # first: if shadowing exceeds `most_db`, no walls are evaluated
            self._add_shadowing(self._waves, senders, receivers, loss)
        floor = self._floor
        if floor is None:
            _path_losses(senders, receivers, self._coefficients, loss)
        else:
            _losses(senders, receivers, self._coefficients, floor, most_db, loss)
        return loss

    def _add_shadowing(self, waves: ShadowingWaves, senders: Floats, receivers: Floats, loss: Floats) -> None:
        """Add the shadowing; phasors are kept by row of `receivers` and reused for those that have not
        moved."""
        p = self._shadowing
        if len(self._cells) != len(receivers):
            self._cells = np.full((len(receivers), 2), NO_SQUARE, np.int64)
            self._phasors = np.empty((4, p.sinusoids, len(receivers)))
        kept = p.grain, waves, self._cells, self._phasors
        refresh(receivers, *kept)
        add_shadowing(senders, receivers, p.sigma_db, p.correlation_distance, *kept, loss)


@kernel
def _path_loss_between(senders: Floats, i: int, receivers: Floats, j: int, coefficients: Floats) -> float:
    dx, dy = receivers[j, 0] - senders[i, 0], receivers[j, 1] - senders[i, 1]
    return max(path_loss(np.sqrt(dx * dx + dy * dy), coefficients), 0.0)


@kernel
def _path_losses(senders: Floats, receivers: Floats, coefficients: Floats, loss_db: Floats) -> None:
    """Add the loss by distance to loss_db, (s, r) dB; at least 0."""
    for i in range(senders.shape[0]):
        for j in range(receivers.shape[0]):
            loss_db[i, j] = max(
                _path_loss_between(senders, i, receivers, j, coefficients) + loss_db[i, j], 0.0
            )


@kernel
def _losses(
    senders: Floats, receivers: Floats, coefficients: Floats, floor: Walls, most_db: float, loss_db: Floats
) -> None:
    """Add the loss by distance and walls to loss_db, (s, r) dB; at least 0.

    A result above most_db may be any value above it.
    """
    side, west, south = TILE * floor.resolution, floor.west, floor.south
    per_tile_db = floor.per_metre_db * side
    for i in range(senders.shape[0]):
        x, y = (senders[i, 0] - west) / side, (senders[i, 1] - south) / side
        for j in range(receivers.shape[0]):
            loss = _path_loss_between(senders, i, receivers, j, coefficients)
            left_db = most_db - (loss + loss_db[i, j])
            if left_db >= 0.0:
                to_x, to_y = (receivers[j, 0] - west) / side, (receivers[j, 1] - south) / side
                loss += wall_loss(floor, per_tile_db, x, y, to_x, to_y, left_db + _ROUNDING_DB)
            loss_db[i, j] = max(loss + loss_db[i, j], 0.0)


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    kinds = (arrays.sin(np.square(np.arange(1200.0))).reshape(30, 40) > 0.8).astype(np.uint8)
    floor = walls_of(kinds, 0.05, -0.2, 0.1, np.array([0.0, 1.0]), np.array([0.0, 22.7]))
    places = np.stack([arrays.cos(np.arange(7.0)), 0.85 + 0.8 * arrays.sin(np.arange(7.0))], axis=1)
    parameters = PropagationParameters(shadowing=ShadowingParameters(4.0))
    propagation = IndoorPropagation(parameters, floor, np.random.default_rng(1))
    tiles = floor.leaps, floor.begins, floor.blocks
    return b"".join(part.tobytes() for part in tiles) + propagation.loss_db(places, places).tobytes()
