"""`acrc bench …` with less to measure: what its options cannot make small is made small here."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from command_line import app

SMALL: Final[dict[tuple[str, str], dict[str, Any]]] = {
    ("radio.speed", "SpeedTask"): {"senders": (1,), "loads": (0.2,), "frames": 100, "repeats": 1},
    ("radio.hardware", "HardwareTask"):
        {"robots": 2, "sides": (3.0,), "loads": (0.1,), "seconds": 1, "draws": 1},
    ("radio.plots", "PlotTask"): {"frames": 10, "places": 50, "seeds": 1, "senders": (2,)},
    ("world.scan", "ScanTask"): {"rays": (64,), "robots": 2, "repeats": 1, "peer_repeats": 1},
    ("world.world", "WorldTask"): {"robots": (4,), "rays": (60,), "seconds_long": 1, "repeats": 1},
    ("foundations.deeco", "DeecoTask"):
        {"replicas": 20, "evaluations": 1, "activations": 100, "senders": 2, "publications": 2,
         "minutes": 0.1, "repeats": 1},
}  # fmt: skip
"""By module and class that says what is measured: what is smaller there."""


def main() -> None:
    """Be `acrc`."""
    for (module, cls), values in SMALL.items():
        place = import_module(f"benchmarks.{module}")
        setattr(place, cls, _smaller(getattr(place, cls), values))
    app.main()


def _smaller(cls: type, values: dict[str, Any]) -> type:
    """The data class with other defaults."""
    annotations = {name: cls.__annotations__[name] for name in values}
    return dataclass(frozen=True)(type(cls.__name__, (cls,), {**values, "__annotations__": annotations}))
