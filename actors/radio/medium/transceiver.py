"""What a transceiver is like: its radio part, which all of a medium share, and the settings of each."""

from dataclasses import dataclass, replace

from actors.ieee802154 import PSDU_LIMIT
from actors.radio.medium.state import Cca


@dataclass(frozen=True)
class PhyParameters:
    """How every receiver of a medium decodes; the defaults are a fair model of a 2.4 GHz O-QPSK receiver."""

    noise_dbm: float = -98.0
    """Thermal noise with the receiver's noise figure, in its 2 MHz, dBm. Default: the bit error rate's
    formula then gives 1 % of lost frames of 20 octets at -97.4 dBm."""
    lock_sinr_db: float = -5.0
    """A receiver locks onto a frame only above this ratio, dB. Default: as ns-3 has it; below, one bit in ten
    is wrong (IEEE 802.15.4-2006, Figure E.2)."""
    cochannel_penalty_db: float = 3.0
    """How much worse another 802.15.4 frame disturbs than white noise of its power, dB. Default: CC2420 data
    sheet, co-channel rejection -3 dB; 0 treats it as noise, which is what ns-3 and INET do."""
    capture_db: float = 3.0
    """How much stronger a later frame must be for the receiver to drop the one it is locked onto, dB.
    Default: Cooja's MRM channel model."""
    capture_us: int = 128
    """How long after the lock that may happen, µs; 0 = never. Default: the preamble, 8 symbols."""
    peak_cca: bool = False
    """False: the energy that counts for clear channel assessment is the mean over all of its 8 symbols, and a
    carrier at any time in them. True: as in ns-3, the level at the end and wherever a frame begins meanwhile;
    what ends before is missed."""
    dead_us: int = 0
    """After each frame that a receiver gives to its computer it receives nothing for so long, µs, while its
    buffer is read."""
    dead_octet_us: int = 0
    """… and for so much longer per octet of the frame, µs."""
    dead_octets: int = PSDU_LIMIT
    """… of at most so many octets."""


@dataclass(frozen=True)
class Transceiver:
    """The settings of one transceiver; the defaults are the standard's, with the MRF24J40's sensitivity."""

    address: int
    """Short address; it keys all random numbers of this transceiver, so it must be its own."""
    tx_power_dbm: float = 0.0
    sensitivity_dbm: float = -95.0
    """No frame that arrives weaker is received, dBm. Default: typical for the MRF24J40 (Microchip
    DS39776C)."""
    cca: Cca = Cca.ENERGY
    """Default: mode 1 of the standard."""
    cca_threshold_dbm: float = -85.0
    """Energy from which the channel counts as busy, dBm. Default: 10 dB above the sensitivity, the most that
    the standard allows (6.9.9)."""
    min_be: int = 3
    max_be: int = 5
    max_backoffs: int = 4
    max_retries: int = 3
    """macMinBE, macMaxBE, macMaxCSMABackoffs, macMaxFrameRetries (7.4.2)."""
    queue: int = 8
    """Frames that the transmit queue holds, with the one that is being sent."""

    def numbered(self, address: int) -> "Transceiver":
        """The same settings with another address."""
        return replace(self, address=address)
