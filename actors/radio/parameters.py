"""What the radio's model can be told, and the presets that a scenario names."""

from dataclasses import dataclass
from typing import Final

from actors.runtime.errors import AcrcError


@dataclass(frozen=True)
class RadioParameters:
    """Link budget, path loss and buffers of every transceiver; the defaults are the preset `chapter`.

    With the defaults a frame reaches 10.5 m in line of sight, the "about 10 m" of the original testbed.
    """

    tx_power_dbm: float = -32.6
    """Transmit power, dBm. Default: the original's 0.000552615 mW (d3scomp/ROSOMNeT,
    omnetpp.ini.template)."""
    sensitivity_dbm: float = -95.0
    """Weakest received power at which a frame is still received, dBm. Default: typical for the MRF24J40
    (Microchip DS39776C); with the original's noise of -96.6 dBm the packet error rate of a 127-octet frame
    passes 1 % within half a dB of it (bit errors by IEEE 802.15.4-2006, E.4.1.8)."""
    near_loss_db: float = 40.2
    """Path loss at 1 m, dB. Default: IEEE 802.15.4-2006 Annex E, as in the original."""
    near_exponent: float = 2.0
    """Path loss exponent up to `breakpoint`. Default: Annex E (free space)."""
    breakpoint: float = 8.0
    """Where the second slope begins, m. Default: Annex E. `inf` makes a plain log-distance model."""
    far_loss_db: float = 58.5
    """Path loss just beyond `breakpoint`, dB. Default: Annex E."""
    far_exponent: float = 3.3
    """Path loss exponent beyond `breakpoint`. Default: Annex E."""
    nearest: float = 0.1
    """Antennas are never taken to be closer than this, m. Default: about the wavelength, 0.12 m, where the
    far-field formula ends."""
    transmit_queue: int = 7
    """Frames that may wait in a transceiver behind the one in the air. Default: the BEE click's command ring
    has 8 slots (d3scomp/beeclickarm, TODQueue.h), one of them for the frame in the air."""
    host_buffer: int = 7
    """Events held for a robot that does not step. Default: the usable slots of the BEE click's answer ring
    (d3scomp/beeclickarm, TOHQueue.h)."""
    rssi_steps_per_db: int = 5
    """Resolution of the reported signal strength, steps per dB. Default: the slope of the MRF24J40's RSSI
    code (DS39776C)."""
    lqi_span_db: float = 20.0
    """How far above the sensitivity the link quality reaches 255, dB; it is 0 at the sensitivity and linear
    between. Default: our choice; IEEE 802.15.4-2006, 6.9.8 asks only for an even spread."""


PRESETS: Final = {
    "chapter": RadioParameters(),
    "beeclick": RadioParameters(tx_power_dbm=-10.0),
}
"""`chapter`: the original testbed's simulation. `beeclick`: the power that the BEE click's firmware sets
(d3scomp/beeclickarm, MRF24J40.cpp: RFCON3 = 0x40), which reaches 50.8 m in line of sight."""


def preset(name: str) -> RadioParameters:
    """The parameters of that name; AcrcError if there is none."""
    if name not in PRESETS:
        raise AcrcError(f"Radio preset {name!r} is unknown; known are {', '.join(PRESETS)}.")
    return PRESETS[name]
