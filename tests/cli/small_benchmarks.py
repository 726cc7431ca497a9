"""`acrc bench …` with less to measure: what its options cannot make small is made small here."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from benchmarks.radio import benchmark
from command_line import app

SMALL: Final[dict[tuple[str, str], dict[str, Any]]] = {
    ("radio.plots", "PlotTask"): {"frames": 10, "places": 50, "seeds": 1, "senders": (2,)},
    ("world.scan", "ScanTask"): {"rays": (64,), "robots": 2, "repeats": 1, "peer_repeats": 1},
    ("world.world", "WorldTask"): {"robots": (4,), "rays": (60,), "seconds_long": 1, "repeats": 1},
    ("foundations.deeco", "DeecoTask"):
        {"replicas": 20, "evaluations": 1, "activations": 100, "senders": 2, "publications": 2,
         "minutes": 0.1, "repeats": 1},
}  # fmt: skip
"""By module and class that says what is measured: what is smaller there."""

RADIO: Final = {
    "_SENDERS": (1,), "_LOADS": (0.2,), "_FRAMES": 100, "_REPEATS": 1, "_ROBOTS": 2, "_SIDES": (3.0,),
    "_PAIR_LOADS": (0.1,), "_SECONDS": 1, "_DRAWS": 1,
}  # fmt: skip
"""The same of the medium's constants."""


def main() -> None:
    """Be `acrc`."""
    for name, value in RADIO.items():
        setattr(benchmark, name, value)
    for (module, cls), values in SMALL.items():
        place = import_module(f"benchmarks.{module}")
        setattr(place, cls, _smaller(getattr(place, cls), values))
    app.main()


def _smaller(cls: type, values: dict[str, Any]) -> type:
    """The data class with other defaults."""
    annotations = {name: cls.__annotations__[name] for name in values}
    return dataclass(frozen=True)(type(cls.__name__, (cls,), {**values, "__annotations__": annotations}))
