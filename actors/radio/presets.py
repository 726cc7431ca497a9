"""The presets that a scenario names: transceiver, receiver, and what lies between, as one."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from actors.radio.medium.state import Cca
from actors.radio.medium.transceiver import PhyParameters, Transceiver
from actors.radio.propagation.indoor import PropagationParameters
from actors.radio.propagation.path_loss import PathLossParameters
from actors.runtime.errors import AcrcError

CHIP_NOISE_DBM: Final = -95.51
"""Noise at which 1 % of frames of 20 octets are lost at -95 dBm, which is how the standard defines the
sensitivity (IEEE 802.15.4-2006, 6.1.7) and what Microchip DS39776C gives as typical for the MRF24J40."""
NO_FLOOR_DBM: Final = -120.0
"""Sensitivity that refuses nothing, where noise alone decides."""


@dataclass(frozen=True)
class RadioParameters:
    """Everything that the radio's model can be told."""

    transceiver: Transceiver
    """Settings of every robot's transceiver; its address is a robot's own."""
    phy: PhyParameters
    """How receivers decode."""
    propagation: PropagationParameters = field(default_factory=PropagationParameters)
    """What lies between the antennas."""
    channel: int = 11
    """11 to 26: where Wi-Fi disturbs. Default: what the BEE click's firmware sets (d3scomp/beeclickarm,
    MRF24J40.cpp, RFCON0 = 0x03)."""
    host_buffer: int = 7
    """Events held for a robot that does not step. Default: the usable slots of the BEE click's answer ring
    (d3scomp/beeclickarm, TOHQueue.h)."""


_CHIP: Final = PhyParameters(noise_dbm=CHIP_NOISE_DBM)
_INET_NOISE_DBM: Final = -96.616
_NS3_NOISE_DBM: Final = -95.4066

PRESETS: Final[Mapping[str, RadioParameters]] = MappingProxyType(
    {
        "chapter": RadioParameters(
            Transceiver(0, tx_power_dbm=-10.0, sensitivity_dbm=NO_FLOOR_DBM, cca=Cca.EITHER),
            _CHIP,
            PropagationParameters(PathLossParameters(excess_db=24.5), walls="brick"),
        ),
        "beeclick": RadioParameters(
            Transceiver(0, tx_power_dbm=-10.0, sensitivity_dbm=NO_FLOOR_DBM, cca_threshold_dbm=-69.0),
            PhyParameters(noise_dbm=CHIP_NOISE_DBM, dead_us=20, dead_octet_us=3, dead_octets=57),
            PropagationParameters(walls="brick"),
        ),
        "rosomnet": RadioParameters(
            Transceiver(0, tx_power_dbm=-32.58, sensitivity_dbm=-100.0, cca_threshold_dbm=-90.0),
            PhyParameters(_INET_NOISE_DBM, lock_sinr_db=-8.0, cochannel_penalty_db=0.0, capture_us=0),
            PropagationParameters(walls="inet_brick"),
        ),
        "ns3": RadioParameters(
            Transceiver(0, sensitivity_dbm=NO_FLOOR_DBM, cca=Cca.EITHER),
            PhyParameters(_NS3_NOISE_DBM, cochannel_penalty_db=0.0, capture_us=0, peak_cca=True),
            PropagationParameters(
                PathLossParameters(40.05, near_exponent=3.0, breakpoint=float("inf"), nearest=1.0)
            ),
        ),
        "ideal": RadioParameters(
            Transceiver(0, cca=Cca.EITHER, queue=64),
            PhyParameters(),
            PropagationParameters(PathLossParameters(40.0, near_exponent=0.0, breakpoint=float("inf"))),
        ),
    }
)
"""`chapter`, the default: a BEE click's chip and power, a textbook clear channel assessment, brick walls and
24.5 dB of excess loss, so that half of the frames of 127 octets arrive at 10 m in line of sight, the range of
the chapter's testbed. The excess is our own choice; it stands for antennas half a metre above the floor
behind the robots' decks. The original reached as far by sending with -32.6 dBm.

`beeclick`: the firmware's registers as they are (d3scomp/beeclickarm, MRF24J40.cpp): RFCON3 = 0x40, -10 dBm;
BBREG2 = 0x80 and CCAEDTH = 0x60, energy alone from -69 dBm; TXMCR = 0x1C, the standard's back-offs. Nothing
is lost but over distance and by walls, so that half of the 127-octet frames arrive at 55 m: stated, not
tuned. A receiver is deaf while 7 octets of header and 50 of data are read from it (SPI at 10.5 MHz, 24 bits
an octet: about 3 µs with the program's part, which is an estimate, as are the 20 µs before).

`rosomnet`: the original simulation (d3scomp/ROSOMNeT, omnetpp.ini.template: 0.000552615 mW) with the defaults
of INET 3.1.1's Ieee802154NarrowbandScalarRadio: sensitivity -100 dBm, energy detection from -90 dBm, lock
from -8 dB, other frames as noise. Not modelled: INET takes the worst ratio for the whole frame.

`ns3`: ns-3.44's lr-wpan at sensitivity -95 dBm over its LogDistancePropagationLossModel, for comparisons.

`ideal`: everyone hears everyone alike; what is left is the time that frames take, and their collisions."""


def preset(name: str) -> RadioParameters:
    """The parameters of that name; AcrcError if there is none."""
    if name not in PRESETS:
        raise AcrcError(f"Radio preset {name!r} is unknown; known are {', '.join(PRESETS)}.")
    return PRESETS[name]
