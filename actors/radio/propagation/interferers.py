"""What disturbs the medium and is no transceiver on it: Wi-Fi stations and jammers (`medium.Interferer`)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from msgspec import Meta
from numpy.random import Generator
from numpy.typing import NDArray

from actors.portable import log10
from actors.portable.draws import exponentials
from actors.radio.medium.medium import Propagation
from actors.settings import Place, Settings

Floats = NDArray[np.float64]
Bursts = NDArray[np.int64]
_BURST_NS: Final = (1_000_000, 2_000_000)
"""Bursts last from the first to the second, ns, evenly distributed: 1 to 2 ms, a frame of 1500 octets at
11 Mb/s with its acknowledgement, or an aggregate of faster ones."""
_CHUNK: Final = 1024
"""Bursts drawn at once."""
_NONE: Final[Bursts] = np.empty((0, 2), np.int64)
DROWNING_DBM: Final = 0.0
"""Power of a jammer wherever it reaches, dBm: above that of any frame over 0.1 m at full power."""


class WifiParameters(Settings, frozen=True):
    """A Wi-Fi station that is on and off: bursts of frames, and silence between."""

    at: Place
    """Where it stands, m, map frame."""
    channel: Annotated[int, Meta(ge=1, le=13, description="a Wi-Fi channel, a whole number from 1 to 13")]
    duty: Annotated[float, Meta(gt=0, lt=1)]
    """Share of the time that it is on."""
    power_dbm: Annotated[float, Meta(ge=-60, le=30, extra={"unit": "dBm"})] = 17.0
    """Radiated, over its whole width of 22 MHz, dBm. Default: own choice, a usual access point; the limit in
    Europe is 20 (ETSI EN 300 328)."""


def in_band_db(wifi_channel: int, radio_channel: int) -> float:
    """Share of a Wi-Fi signal's power within 2 MHz around an 802.15.4 channel, 11 to 26, dB.

    The transmit spectrum mask of the 22 MHz wide DSSS (IEEE 802.11-2012, HR/DSSS PHY): even within 11 MHz of
    the middle, 30 dB below that up to 22 MHz, 50 dB beyond. So it is at most -10.4 dB.
    """
    offset_mhz = abs((2412 + 5 * (wifi_channel - 1)) - (2405 + 5 * (radio_channel - 11)))
    below = 0.0 if offset_mhz <= 11 else 30.0 if offset_mhz <= 22 else 50.0
    return 10.0 * log10(2.0 / 22.0) - below


class Wifi:
    """A Wi-Fi station; its bursts are a function of its draws alone.

    Silence is exponentially distributed, as of many independent senders behind one access point; the first
    burst follows a silence. `draws` gives a new generator of the same numbers at each call.
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
        """Return bursts as `medium.Interferer` defines; a time before the last one restarts the drawing."""
        if since_ns < self._forgotten:
            self._begin_anew()
        while self._drawn_until < until_ns:
            self._draw()
        begins = self._known[:, 0]
        first, last = np.searchsorted(begins, (since_ns, until_ns))
        found: Bursts = self._known[first:last].copy()
        if first > 4 * _CHUNK:
            self._known, self._forgotten = self._known[first:], since_ns
        return found

    def power_dbm(self, receivers: Floats) -> Floats:
        """As `medium.Interferer` says."""
        flat = receivers.reshape(-1, 2)
        loss = self._propagation.loss_db(self._place, flat)
        power: Floats = self._radiated_dbm - loss.reshape(receivers.shape[:-1])
        return power

    def over(self, now_ns: int) -> bool:
        """As `medium.Interferer` says: never."""
        return False

    def _begin_anew(self) -> None:
        self._rng = self._draws()
        self._known = _NONE
        self._drawn_until = self._forgotten = 0

    def _draw(self) -> None:
        """Add bursts behind those that are known."""
        shortest, longest = _BURST_NS
        lengths = self._rng.integers(shortest, longest, _CHUNK, endpoint=True)
        mean_silence = (shortest + longest) / 2 * (1.0 - self._duty) / self._duty
        silences = np.rint(exponentials(self._rng, mean_silence, _CHUNK)).astype(np.int64)
        ends = self._drawn_until + np.cumsum(silences + lengths)
        self._known = np.concatenate([self._known, np.stack([ends - lengths, ends], axis=1)])
        self._drawn_until = int(ends[-1])


@dataclass(frozen=True)
class Jammer:
    """A source that drowns everything within its radius, and is not noticed beyond, from since to until."""

    x: float
    y: float
    """Where it stands, m, map frame."""
    radius: float
    """m; walls do not count."""
    since_ns: int
    until_ns: int

    def bursts(self, since_ns: int, until_ns: int) -> Bursts:
        """As `medium.Interferer` says: one."""
        if since_ns <= self.since_ns < until_ns and self.since_ns < self.until_ns:
            return np.array([[self.since_ns, self.until_ns]], np.int64)
        return _NONE

    def over(self, now_ns: int) -> bool:
        """As `medium.Interferer` says."""
        return self.until_ns < now_ns

    def power_dbm(self, receivers: Floats) -> Floats:
        """As `medium.Interferer` says."""
        away = np.square(receivers[..., 0] - self.x) + np.square(receivers[..., 1] - self.y)
        return np.where(away <= self.radius * self.radius, DROWNING_DBM, -np.inf)
