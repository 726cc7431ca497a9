"""What a base and a bridge are started with, as whoever starts the robot has it."""

from pathlib import Path
from typing import Final, Self

import msgspec

from actors.robot_model import RobotDescription
from actors.runtime.process_setup import ActorSetup, ProcessSetup, located_model

OPENNI: Final = "openni"
"""The range sensor that is no port: a depth camera, found by itself."""
PATIENCE_S: Final = 30.0
"""Of a base; own choice: a restarted robot should be there by then."""


class BaseSetup(RobotDescription, frozen=True, kw_only=True):
    """Everything a base needs to know."""

    step_us: int
    base: str
    """Path of the Kobuki's port."""
    range: str | None
    """Path of the lidar's port, or OPENNI; None = there is none."""
    listen: str | None = None
    """Where the operator's laptop may connect, `tls/HOST:PORT`; None = nowhere."""
    keys: str | None = None
    """Folder with the robot's own keys; needed to listen."""
    last_pose: str | None = None
    """File with where the robot last held itself to be; None: nobody keeps it."""
    patience_s: float | None = PATIENCE_S
    """A robot or bridge that does not answer for so long hangs, and the base ends, s. None: a debugger may
    hold it."""

    def located(self, folder: Path) -> Self:
        """With its files as they are called for who does not stand in `folder`, where the set-up lies."""
        last_pose = None if self.last_pose is None else str(folder / self.last_pose)
        return msgspec.structs.replace(self, model=located_model(self.model, folder), last_pose=last_pose)


class BridgeSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a bridge needs to know."""

    robot: str
    step_us: int
    radio: str
    """Path of the board's port."""
    address: int
    pan: int
    channel: int
    """11 to 26."""
    power_dbm: float
    board: bool = True
    """False: at the port is a transceiver of a laboratory's, without a board (`transceiver_line`)."""


BaseProgram = ActorSetup[BaseSetup, ProcessSetup]
"""What a base's process reads."""
BridgeProgram = ActorSetup[BridgeSetup, ProcessSetup]
"""What a bridge's process reads."""
