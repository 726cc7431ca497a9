"""The medium: how fast it is, what the firmware's clear channel assessment costs; or its figures, drawn."""

from pathlib import Path

from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from benchmarks.radio import hardware, plots, speed
from benchmarks.statistics.measured import Measured

_CORRIDOR = SHIPPED / "maps" / "corridor.yaml"


def measure(out: Path | None = None, data: Path | None = None, map_file: Path = _CORRIDOR) -> Measured:
    """Measure; or, with `out`, only draw the figures of docs/radio.md into that folder.

    `data`: a folder with figures of ns-3, for its dots. `map_file`: whose floor the last figure has.
    """
    if out is not None:
        return plots.draw(out, map_file, data)
    if data is not None:
        raise OptionError("--data: needs --out; without it nothing is drawn")
    fast, cost = speed.measure(), hardware.measure()
    return Measured({"speed": fast.figures, "assessment": cost.figures}, (*fast.shown, *cost.shown))
