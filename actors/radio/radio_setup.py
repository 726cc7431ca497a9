"""What the radio's process is told at its start."""

from pathlib import Path
from typing import Self

import msgspec

from actors.radio.propagation.interferers import WifiParameters
from actors.radio.propagation.walls import WallPatch
from actors.runtime.process_setup import ActorSetup, ProcessSetup


class RadioSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The robots with transceivers, and the radio's model; what is None is as the preset has it."""

    seed: int
    """Of everything random on the medium; the run's, if that has no key."""
    step_us: int
    """Length of a step, µs."""
    robots: tuple[tuple[str, int], ...]
    """Id and short address (IEEE 802.15.4) of every robot, in the order of the scenario."""
    preset: str = "chapter"
    """Name of the model's parameters, see `presets.PRESETS`."""
    map: str = ""
    """Path of the floor plan's YAML; empty: there are no walls."""
    walls: str | None = None
    """Material of what the floor plan has as occupied, see `materials.MATERIALS`."""
    patches: tuple[WallPatch, ...] = ()
    """Where it is of another one."""
    shadowing_db: float | None = None
    """Standard deviation of the shadowing, dB."""
    correlation_distance: float | None = None
    """Over which the shadowing changes, m."""
    channel: int | None = None
    """11 to 26."""
    wifi: tuple[WifiParameters, ...] = ()
    """Wi-Fi stations about."""

    def located(self, folder: Path) -> Self:
        """With its map as it is called for who does not stand in `folder`, where the set-up lies."""
        return msgspec.structs.replace(self, map=str(folder / self.map)) if self.map else self


RadioProgram = ActorSetup[RadioSetup, ProcessSetup]
"""What a radio's process reads."""
