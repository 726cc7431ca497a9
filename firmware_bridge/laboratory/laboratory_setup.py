"""What a laboratory is built from, and what it says in the end: JSON files."""

from pathlib import Path

import msgspec

from actors.radio.radio_model import RadioSetup
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.task.referee import PlaceOutcome
from actors.world.world_setup import WorldSetup


class LaboratorySetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a laboratory needs to know. Raises AcrcError for what it cannot be."""

    world: WorldSetup
    """Its step and its duration are not used, as nobody conducts a laboratory, nor what its events want of
    robots' processes."""
    radio: RadioSetup
    """Of the air, as in a simulated run; the boards learn their addresses from their hosts, and the result
    tells both."""
    without_board: tuple[str, ...] = ()
    """Robots with a simulated transceiver in a board's place."""

    def __post_init__(self) -> None:
        robots = [robot.id for robot in self.world.robots]
        for robot in robots:
            if not robot or robot.startswith(".") or "/" in robot or not robot.isprintable() or " " in robot:
                raise AcrcError(
                    f"a robot {robot!r}; its name should do as a folder's and as a word of a command"
                )
        named = [robot for robot, _ in self.radio.robots]
        if sorted(named) != sorted(set(robots)) or len(set(robots)) != len(robots):
            raise AcrcError(
                f"robots {', '.join(robots)} and addresses of {', '.join(named) or 'nobody'}; "
                "each robot should have one name and one address"
            )


class LaboratoryTruth(msgspec.Struct, frozen=True):
    """Where a robot truly is in the end."""

    pose: tuple[float, float, float]
    """x, y in m and heading in rad, map frame."""
    travelled: float
    """Length of its way, m."""


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
    """Bytes that a robot's process did not read in time, by robot and device."""
    boards: dict[str, dict[str, int]]
    """Each board's counters, and the address and the channel (11 to 26) that its host gave it; a simulated
    transceiver's are its address and channel alone."""
    behind_ms: dict[str, int]
    """Sub-steps of the physics by how late they were made, in whole milliseconds."""
    lost_ms: int
    """Wall time that was left out because the laboratory was too late to make it up."""
    robots: dict[str, LaboratoryTruth] = {}
    bases: dict[str, dict[str, int]] = {}
    """Frames from each base's driver that were right, and bytes that were skipped."""
    frames: dict[str, int] = {}
    """What became of all frames, as the radio of a simulated run tells it."""
    frames_by_robot: dict[str, dict[str, int]] = {}
    cpu_s: float = 0.0
    """Processor time since the beginning, s."""


def load(path: Path) -> LaboratorySetup:
    """The set-up in a JSON file, whose paths are relative to its folder. Raises AcrcError."""
    setup = typed_json.read(path, LaboratorySetup, "set-up of a laboratory")
    world, radio = setup.world.located(path.parent), setup.radio.located(path.parent)
    return msgspec.structs.replace(setup, world=world, radio=radio)
