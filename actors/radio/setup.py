"""What the radio's process is told at its start."""

import msgspec


class RadioSetup(msgspec.Struct, frozen=True):
    """The stations and the model of the air."""

    seed: int
    """The run's seed; the present medium has no noise and draws nothing from it."""
    step_us: int
    """Length of a step, µs."""
    robots: tuple[tuple[str, int], ...]
    """Id and short address (IEEE 802.15.4) of every robot, in the order of the scenario."""
    preset: str = "chapter"
    """Name of the model's parameters, see `parameters.PRESETS`."""
