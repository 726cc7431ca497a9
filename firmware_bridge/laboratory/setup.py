"""What a laboratory is built from, and what it says in the end: JSON files."""

import msgspec

from actors.world.referee import PlaceOutcome
from actors.world.setup import WorldSetup


class LaboratorySetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a laboratory needs to know."""

    world: WorldSetup
    addresses: tuple[tuple[str, int], ...]
    """Short address of each robot's board, for people; the boards learn theirs from their hosts."""
    radio: str
    """Name of the radio's parameters: path loss and sensitivity."""


class LaboratoryResult(msgspec.Struct, frozen=True):
    """What truly happened."""

    began_us: int
    """Wall clock at the beginning, µs since the Unix epoch."""
    simulated_s: float
    contacts: int
    places: tuple[PlaceOutcome, ...]
    """When ground truth first came within reach of each, µs after the beginning; what was said of them stands
    in the robots' own recordings."""
    lines: dict[str, int]
    """Bytes that a robot's process did not read in time, by device."""
    boards: dict[str, dict[str, int]]
    behind_ms: dict[str, int]
    """Rounds by how late they were, in whole milliseconds; those of a second and more count as 1000."""
    lost_ms: int
    """Wall time that was left out because the laboratory was too late to make it up."""
