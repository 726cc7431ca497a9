"""Radio model: presets, changes of a set-up, propagation and link budget."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, Self

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.random import Generator

from actors.array_types import Floats, Int64s
from actors.floor.map_file import load_map
from actors.ieee802154 import PSDU_LIMIT
from actors.portable import log10
from actors.portable.draws import exponentials
from actors.radio.medium.medium import Interferer, Propagation
from actors.radio.medium.reception import frame_error_rate
from actors.radio.medium.state import PhyParameters, Transceiver
from actors.radio.propagation import IndoorPropagation, PropagationParameters, line_of_sight
from actors.radio.walls import MaterialName, WallPatch, build, material
from actors.randomness import generator
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import ActorSetup, ProcessSetup, RecordDetail
from actors.settings import Place, Settings, Text

Bursts = Int64s
_BURST_NS: Final = (1_000_000, 2_000_000)
"""Shortest and longest burst, ns, uniformly distributed: a frame of 1500 octets at 11 Mb/s with its
acknowledgement, or an aggregate of faster ones."""
_CHUNK: Final = 1024
"""Number of bursts drawn at once."""
_NONE: Final[Bursts] = np.empty((0, 2), np.int64)
JAMMER_DBM: Final = 0.0
"""Power of a jammer within its radius, dBm: above that of any frame over 0.1 m at full power."""


class WifiParameters(Settings, frozen=True):
    """A Wi-Fi station that sends bursts of frames."""

    at: Place
    """Position, m, map frame."""
    channel: Annotated[int, Meta(ge=1, le=13, description="a Wi-Fi channel, a whole number from 1 to 13")]
    duty: Annotated[float, Meta(gt=0, lt=1)]
    """Share of time in which it sends."""
    power_dbm: Annotated[float, Meta(ge=-60, le=30, extra={"unit": "dBm"})] = 17.0
    """Radiated power over its width of 22 MHz, dBm. Default: own choice, a usual access point; the limit in
    Europe is 20 (ETSI EN 300 328)."""


def in_band_db(wifi_channel: int, radio_channel: int) -> float:
    """Return the share of a Wi-Fi signal's power within 2 MHz around an 802.15.4 channel, 11 to 26, dB.

    Transmit spectrum mask of the 22 MHz wide DSSS (IEEE 802.11-2012, HR/DSSS PHY): flat within 11 MHz of the
    centre, 30 dB lower up to 22 MHz, 50 dB lower beyond. The share is thus at most -10.4 dB.
    """
    offset_mhz = abs((2412 + 5 * (wifi_channel - 1)) - (2405 + 5 * (radio_channel - 11)))
    below = 0.0 if offset_mhz <= 11 else 30.0 if offset_mhz <= 22 else 50.0
    return 10.0 * log10(2.0 / 22.0) - below


class WifiInterferer:
    """A Wi-Fi station whose bursts depend only on its draws.

    Pauses are exponentially distributed, as with many independent senders behind one access point; the first
    burst follows a pause. `draws` returns a new generator of the same numbers at each call.
    """

    def __init__(
        self,
        parameters: WifiParameters,
        radio_channel: int,
        propagation: Propagation,
        draws: Callable[[], Generator],
    ) -> None:
        self._duty = parameters.duty
        self._radiated_dbm = parameters.power_dbm + in_band_db(parameters.channel, radio_channel)
        self._place = np.array([parameters.at])
        self._propagation = propagation
        self._draws = draws
        self._rng = draws()
        self._known = _NONE
        self._drawn_until = self._forgotten = 0

    def bursts(self, since_ns: int, until_ns: int) -> Bursts:
        """Return bursts as `medium.Interferer` defines; an earlier time than before restarts the drawing."""
        if since_ns < self._forgotten:
            self._restart()
        while self._drawn_until < until_ns:
            self._draw()
        begins = self._known[:, 0]
        first, last = np.searchsorted(begins, (since_ns, until_ns))
        found: Bursts = self._known[first:last].copy()
        if first > 4 * _CHUNK:
            self._known, self._forgotten = self._known[first:], since_ns
        return found

    def power_dbm(self, receivers: Floats) -> Floats:
        """Return the power as `medium.Interferer` defines it."""
        loss = self._propagation.loss_db(self._place, receivers.reshape(-1, 2))
        return self._radiated_dbm - loss.reshape(receivers.shape[:-1])

    def has_ended(self, now_ns: int) -> bool:
        """Return False: a station never ends."""
        return False

    def _restart(self) -> None:
        self._rng = self._draws()
        self._known = _NONE
        self._drawn_until = self._forgotten = 0

    def _draw(self) -> None:
        """Append further bursts."""
        shortest, longest = _BURST_NS
        lengths = self._rng.integers(shortest, longest, _CHUNK, endpoint=True)
        mean_silence = (shortest + longest) / 2 * (1.0 - self._duty) / self._duty
        silences = np.rint(exponentials(self._rng, mean_silence, _CHUNK)).astype(np.int64)
        ends = self._drawn_until + np.cumsum(silences + lengths)
        self._known = np.concatenate([self._known, np.stack([ends - lengths, ends], axis=1)])
        self._drawn_until = int(ends[-1])


class Jammer(msgspec.Struct, frozen=True):
    """An interferer that blocks all reception within its radius for one burst, without effect beyond."""

    x: float
    y: float
    """Position, m, map frame."""
    radius: float
    """Radius, m; walls have no effect."""
    since_ns: int
    until_ns: int

    def bursts(self, since_ns: int, until_ns: int) -> Bursts:
        """Return its burst if that begins in the window."""
        if since_ns <= self.since_ns < until_ns and self.since_ns < self.until_ns:
            return np.array([[self.since_ns, self.until_ns]], np.int64)
        return _NONE

    def has_ended(self, now_ns: int) -> bool:
        """Return whether its burst has ended."""
        return self.until_ns < now_ns

    def power_dbm(self, receivers: Floats) -> Floats:
        """Return the power as `medium.Interferer` defines it."""
        away = np.square(receivers[..., 0] - self.x) + np.square(receivers[..., 1] - self.y)
        return np.where(away <= self.radius * self.radius, JAMMER_DBM, -np.inf)


Channel = Annotated[
    int, Meta(ge=11, le=26, description="an IEEE 802.15.4 channel, a whole number from 11 to 26")
]


class RadioParameters(msgspec.Struct, frozen=True):
    """Parameters of the radio model."""

    transceiver: Transceiver
    """Settings of every robot's transceiver, except its address."""
    phy: PhyParameters
    """Parameters of reception."""
    propagation: PropagationParameters = msgspec.field(default_factory=PropagationParameters)
    """Parameters of the loss between antennas."""
    channel: int = 11
    """IEEE 802.15.4 channel, 11 to 26; matters only with Wi-Fi. Default: as in the BEE click's firmware
    (d3scomp/beeclickarm, MRF24J40.cpp, RFCON0 = 0x03)."""
    host_buffer: int = 7
    """Events held for a robot that is not stepping. Default: usable slots of the BEE click's answer ring
    (d3scomp/beeclickarm, TOHQueue.h)."""


_FILE: Final = Path(__file__).with_name("presets.toml")
PRESETS: Final = MappingProxyType(msgspec.toml.decode(_FILE.read_bytes(), type=dict[str, RadioParameters]))
"""Parameters of each preset; presets.toml states their sources."""


def preset(name: str) -> RadioParameters:
    """Return the parameters of a preset. Raises AcrcError for an unknown name."""
    if name not in PRESETS:
        raise AcrcError(f"Radio preset {name!r} is unknown; known are {', '.join(PRESETS)}.")
    return PRESETS[name]


class RadioTable(Settings, frozen=True):
    """Changes to a preset of the radio model; None keeps the preset's value."""

    preset: Annotated[Text, Meta(description='the name of a radio preset, such as "chapter"')] = "chapter"
    """Name of a preset, see `PRESETS`."""
    channel: Channel | None = None
    """IEEE 802.15.4 channel; matters only with Wi-Fi."""
    walls: MaterialName | None = None
    """Material of occupied cells on the map, see `walls.MATERIALS`; "air": no loss by walls."""
    excess_db: Annotated[float, Meta(ge=-60, le=120, extra={"unit": "dB"})] | None = None
    """Additional loss at any distance, dB, of antennas, their housing and their height above the floor."""
    shadowing_db: Annotated[float, Meta(ge=0, le=30, extra={"unit": "dB"})] | None = None
    """Standard deviation of the shadowing, dB; 0: none."""
    correlation_distance: Annotated[float, Meta(ge=0.1, le=1000, extra={"unit": "metres"})] | None = None
    """Correlation distance of the shadowing, m."""


class RadioSetup(RadioTable, frozen=True, kw_only=True):
    """Robots with transceivers, and the radio model."""

    seed: int
    """Seed of everything random on the medium; without a key that of the run."""
    step_us: int
    """Length of a step, µs."""
    robots: tuple[tuple[str, int], ...]
    """Id and short address (IEEE 802.15.4) of every robot, in the order of the scenario."""
    map: str = ""
    """Path of the floor plan's YAML; empty: no walls."""
    patches: tuple[WallPatch, ...] = ()
    """Areas with walls of another material."""
    wifi: tuple[WifiParameters, ...] = ()
    """Wi-Fi stations."""
    detail: RecordDetail = "lean"
    """Level of detail of the radio's recording."""

    def resolve_paths(self, folder: Path) -> Self:
        """Return the set-up with its map's path relative to `folder` resolved."""
        return msgspec.structs.replace(self, map=str(folder / self.map)) if self.map else self


RadioProgram = ActorSetup[RadioSetup, ProcessSetup]
"""Set-up file of a radio's process."""


class RadioModel(msgspec.Struct, frozen=True):
    """Model of a run's medium, except the transceivers' addresses."""

    parameters: RadioParameters
    """The preset with the changes of the set-up."""
    propagation: IndoorPropagation
    interferers: tuple[Interferer, ...]


def radio_model(setup: RadioSetup) -> RadioModel:
    """Return the model of a set-up. Raises AcrcError for an unknown name or an unreadable map."""
    parameters = radio_parameters(setup)
    walls = parameters.propagation.walls
    floor = build(load_map(setup.map), walls, setup.patches) if setup.map else None

    def propagation() -> IndoorPropagation:  # separate objects, as each caches phasors
        return IndoorPropagation(parameters.propagation, floor, generator(setup.seed, "radio shadowing", ""))

    stations = tuple(
        WifiInterferer(
            station, parameters.channel, propagation(), partial(generator, setup.seed, "Wi-Fi", str(number))
        )
        for number, station in enumerate(setup.wifi)
    )
    return RadioModel(parameters, propagation(), stations)


def radio_parameters(setup: RadioSetup) -> RadioParameters:
    """Return the preset with the changes of the set-up. Raises AcrcError for an unknown name."""
    base = preset(setup.preset)
    shadowing = base.propagation.shadowing
    if setup.shadowing_db is not None:
        shadowing = replace(shadowing, sigma_db=setup.shadowing_db)
    if setup.correlation_distance is not None:
        shadowing = replace(shadowing, correlation_distance=setup.correlation_distance)
    path_loss = base.propagation.path_loss
    if setup.excess_db is not None:
        path_loss = replace(path_loss, excess_db=setup.excess_db)
    walls = setup.walls or base.propagation.walls
    material(walls)
    propagation = replace(base.propagation, walls=walls, path_loss=path_loss, shadowing=shadowing)
    return replace(base, channel=setup.channel or base.channel, propagation=propagation)


_PERIOD_US: Final = 1_000_000


def required_dbm(parameters: RadioParameters, share: float = 0.5, octets: int = PSDU_LIMIT) -> float:
    """Return the received power, dBm, at which this share of frames of `octets` arrives undisturbed.

    Default: the longest frames, which have the shortest range.
    """
    low, high = -30.0, 30.0
    for _ in range(60):
        middle = (low + high) / 2
        lost = float(frame_error_rate(np.array([middle]), octets)[0])
        low, high = (middle, high) if lost > 1.0 - share else (low, middle)
    phy = parameters.phy
    return max(phy.noise_dbm + max(high, phy.lock_sinr_db), parameters.transceiver.sensitivity_dbm)


def reach(parameters: RadioParameters, share: float = 0.5, octets: int = PSDU_LIMIT) -> float:
    """Return the distance, m, in line of sight and without shadowing, over which this share of frames
    arrives."""
    budget_db = parameters.transceiver.tx_power_dbm - required_dbm(parameters, share, octets)
    return line_of_sight(budget_db, parameters.propagation.path_loss)


class RadioReport(msgspec.Struct, frozen=True):
    """Counts of a run's frames and events; last record of its radio."""

    frames: dict[str, int]
    """Counts of all robots; with `pairs` and `pairs_in_reach` (`DirectReach`)."""
    frames_by_robot: dict[str, dict[str, int]]


class DirectReach:
    """Counts, once per second, the pairs of robots that receive at least half of each other's longest
    frames."""

    def __init__(self, parameters: RadioParameters, propagation: Propagation) -> None:
        self._greatest_loss_db = parameters.transceiver.tx_power_dbm - required_dbm(parameters)
        self._propagation = propagation
        self._next = 0
        self._pairs = self._in_reach = 0

    def is_due(self, instant_us: int) -> bool:
        """Return whether a new second has begun since the last count."""
        return instant_us >= self._next

    def count_pairs(self, instant_us: int, places: Floats) -> None:
        """Count the pairs of powered robots at these places, (n, 2) m."""
        self._next = (instant_us // _PERIOD_US + 1) * _PERIOD_US
        loss = self._propagation.loss_db(places, places, self._greatest_loss_db)
        one, other = np.triu_indices(len(places), 1)
        self._pairs += one.size
        self._in_reach += int(np.count_nonzero(loss[one, other] <= self._greatest_loss_db))

    def counters(self) -> dict[str, int]:
        """Return `pairs`, all pairs counted, and `pairs_in_reach`, those within direct reach."""
        return {"pairs": self._pairs, "pairs_in_reach": self._in_reach}


def share(counters: dict[str, int]) -> float | None:
    """Return the share of pairs in direct reach, from `DirectReach.counters`; None without pairs."""
    pairs = counters["pairs"]
    return round(counters["pairs_in_reach"] / pairs, 4) if pairs else None
