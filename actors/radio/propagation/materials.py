"""What walls are made of: how much of a signal at 2.45 GHz they take.

The table of ITU-R P.2040-3 gives permittivity and conductivity; from them follow, for a wave that meets the
wall at a right angle, what its two faces reflect and what a metre of it absorbs. Beside these stand the wall
types of COST 231, which cost the same however thick they are drawn.
"""

import math
from dataclasses import dataclass
from typing import Final

from actors.portable import exp, log, log10
from actors.runtime.errors import AcrcError

_GHZ: Final = 2.45
"""The middle of the band, channels 11 to 26."""


@dataclass(frozen=True)
class Material:
    """What a wall takes from a signal that crosses it."""

    crossing_db: float
    """Loss of each wall that is entered, dB, however thick."""
    per_metre_db: float
    """Loss of each metre in it, dB."""


def dielectric(permittivity: float, conductivity: float, growth: float) -> Material:
    """A material of that real relative permittivity and of conductivity · GHz^growth, S/m, at 2.45 GHz.

    Faces: Fresnel's reflection at a right angle, twice, without what bounces to and fro within. Absorption:
    1636 σ / √η' dB/m, for low losses (ITU-R P.2040-3, section 2.1, table 3).
    """
    index = math.sqrt(permittivity)
    reflected = (index - 1.0) / (index + 1.0)
    face = 1.0 - reflected * reflected
    growing = exp(growth * log(_GHZ))
    return Material(-20.0 * log10(face), 1636.0 * conductivity * growing / index)


MATERIALS: Final = {
    "air": Material(0.0, 0.0),
    "concrete": dielectric(5.24, 0.0462, 0.7822),
    "brick": dielectric(3.91, 0.0238, 0.16),
    "plasterboard": dielectric(2.73, 0.0085, 0.9395),
    "wood": dielectric(1.99, 0.0047, 1.0718),
    "chipboard": dielectric(2.58, 0.0217, 0.78),
    "glass": dielectric(6.31, 0.0036, 1.3394),
    "metal": Material(20.0, 0.0),
    "light_wall": Material(3.4, 0.0),
    "heavy_wall": Material(6.9, 0.0),
    "inet_brick": Material(0.6, 0.0),
}
"""By name. `metal`: own choice; nothing passes, so the figure stands for what finds a way round, as measured
at doors. `light_wall` and `heavy_wall`: thin walls that bear nothing, and thick or load-bearing ones of brick
or concrete (COST 231, final report, chapter 4, multi-wall model, fitted at 1800 MHz). `inet_brick`: what INET
3.1.1 makes of brick with resistivity 3 kΩm and permittivity 4.5, the walls of d3scomp/ROSOMNeT: what the
first face reflects, and next to nothing for the rest (TracingObstacleLoss, which leaves the second out)."""


def material(name: str) -> Material:
    """The material of that name; AcrcError if there is none."""
    if name not in MATERIALS:
        raise AcrcError(f"Wall material {name!r} is unknown; known are {', '.join(MATERIALS)}.")
    return MATERIALS[name]
