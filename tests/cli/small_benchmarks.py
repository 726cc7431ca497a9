"""`acrc bench …` with less to measure: what its options cannot make small is made small here."""

import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from command_line import app

SMALL: Final[dict[str, tuple[str, str, dict[str, Any]]]] = {
    "radio-speed": ("radio.speed", "SpeedTask",
                    {"senders": (1,), "loads": (0.2,), "frames": 100, "repeats": 1}),
    "radio-hardware": ("radio.hardware", "HardwareTask",
                       {"robots": 2, "sides": (3.0,), "loads": (0.1,), "seconds": 1, "draws": 1}),
    "radio-plots": ("radio.plots", "PlotTask", {"frames": 10, "places": 50, "seeds": 1, "senders": (2,)}),
    "scan": ("world.scan", "ScanTask", {"rays": (64,), "robots": 2, "repeats": 1, "peer_repeats": 1}),
    "world": ("world.world", "WorldTask", {"robots": (4,), "rays": (60,), "seconds_long": 1, "repeats": 1}),
    "deeco": ("foundations.deeco", "DeecoTask",
              {"replicas": 20, "evaluations": 1, "activations": 100, "senders": 2, "publications": 2,
               "minutes": 0.1, "repeats": 1}),
    "onboard": ("hardware.onboard", "OnboardTask", {"robots": 2, "duration": 3.0}),
}  # fmt: skip
"""By the benchmark's name: its module, the class that says what it measures, and what is smaller there."""
FEW: Final[dict[str, dict[tuple[str, str], int]]] = {
    "attacks": {("attacks.command", "ATTACKS"): 8},
    "standstill": {
        ("hardware.standstill", "PROCESSES"): 0,
        ("hardware.standstill", "DEVICES"): 1,
        ("hardware.sensor_trials", "FAULTS"): 2,
    },
}
"""By name: module and table of what is tried one by one, and how much of it is left."""


def main() -> None:
    """Be `acrc`, for the benchmark that is asked for."""
    name = sys.argv[2]
    if name in SMALL:
        module, cls, values = SMALL[name]
        place = import_module(f"benchmarks.{module}")
        setattr(place, cls, _smaller(getattr(place, cls), values))
    for (module, table), most in FEW.get(name, {}).items():
        place = import_module(f"benchmarks.{module}")
        whole = getattr(place, table)
        setattr(place, table, dict([*whole.items()][:most]) if isinstance(whole, dict) else whole[:most])
    app.main()


def _smaller(cls: type, values: dict[str, Any]) -> type:
    """The data class with other defaults."""
    annotations = {name: cls.__annotations__[name] for name in values}
    return dataclass(frozen=True)(type(cls.__name__, (cls,), {**values, "__annotations__": annotations}))
