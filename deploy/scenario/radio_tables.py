"""The tables of a scenario file that say how the air is: [radio], [[wall]] and [[wifi]]."""

from typing import Annotated, Final

from pydantic import AfterValidator, Field

from actors.radio.propagation.materials import MATERIALS
from actors.table import A_POINT, FileTable, Point, Right, Span, Text

MOST_WIFI: Final = 20


def _known(name: str) -> str:
    if name not in MATERIALS:
        raise ValueError
    return name


Material = Annotated[
    str,
    AfterValidator(_known),
    Right("a material: " + ", ".join(f'"{name}"' for name in MATERIALS)),
]


class RadioTable(FileTable):
    """[radio]: the model of the air; what is absent is as the preset has it."""

    preset: Annotated[Text, Right('the name of a radio preset, such as "chapter"')] = "chapter"
    """Name of the radio's parameters."""
    channel: Annotated[
        int | None, Field(ge=11, le=26), Right("an IEEE 802.15.4 channel, a whole number from 11 to 26")
    ] = None
    """Which part of the band the frames use; it counts where there is Wi-Fi."""
    walls: Material | None = None
    """What everything is made of that is occupied on the map; "air": walls cost nothing."""
    shadowing_db: Annotated[float | None, Field(ge=0, le=30), Right("a number of dB from 0 to 30")] = None
    """Standard deviation of the loss between places alike, dB; 0: none."""
    correlation_distance: Annotated[
        float | None, Field(ge=0.1, le=1000), Right("a number of metres from 0.1 to 1000")
    ] = None
    """Over which the shadowing changes, m."""


class WallTable(FileTable):
    """[[wall]]: a rectangle in which what is occupied on the map is of a material of its own."""

    material: Material
    x: Span
    """From west to east, m."""
    y: Span
    """From south to north, m."""


class WifiTable(FileTable):
    """[[wifi]]: a Wi-Fi station that is on and off."""

    at: Annotated[Point, Right(A_POINT)]
    """Where it stands."""
    channel: Annotated[int, Field(ge=1, le=13), Right("a Wi-Fi channel, a whole number from 1 to 13")]
    duty: Annotated[float, Field(gt=0, lt=1), Right("a number above 0 and below 1")]
    """Share of the time that it sends."""
    power_dbm: Annotated[float, Field(ge=-60, le=30), Right("a number of dBm from -60 to 30")] = 17.0
    """Radiated power, dBm."""
