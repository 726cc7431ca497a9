"""Orders to a run: what a person, a tool or an event of the scenario may ask of the world.

They travel in `actors.messages.Control`; positions are metres in the map frame, angles radians.
"""

from actors.topic import MessagePart


class Kill(MessagePart, frozen=True, tag="kill"):
    """End the robot's process; its body stays as an obstacle."""

    robot: str


class Freeze(MessagePart, frozen=True, tag="freeze"):
    """Stop advancing the robot's core."""

    robot: str


class Thaw(MessagePart, frozen=True, tag="thaw"):
    """Advance a frozen robot's core again."""

    robot: str


class Restart(MessagePart, frozen=True, tag="restart"):
    """Start a new process for the robot, in a new boot epoch; a running one is ended first."""

    robot: str


class Move(MessagePart, frozen=True, tag="move"):
    """Put the robot's body somewhere else."""

    robot: str
    x: float
    y: float
    heading: float


class StartJam(MessagePart, frozen=True, tag="jam"):
    """Switch a jammer on for `duration` µs."""

    x: float
    y: float
    radius: float
    duration: int


class Lose(MessagePart, frozen=True, tag="lose"):
    """Let the robot not receive the next frame of `sender` that it would have received."""

    robot: str
    sender: str


class Obstacle(MessagePart, frozen=True, tag="obstacle"):
    """Put a round thing of `radius` m, that does not move, on the floor."""

    x: float
    y: float
    radius: float


class Wall(MessagePart, frozen=True, tag="wall"):
    """Put a straight wall between two points on the floor, m; it does not move, and radio passes it."""

    x: float
    y: float
    to_x: float
    to_y: float


class Give(MessagePart, frozen=True, tag="give"):
    """Give the robot further places to clean, m, map frame."""

    robot: str
    places: tuple[tuple[float, float], ...]


class CloseDoor(MessagePart, frozen=True, tag="close"):
    """Close the door that the point, m, lies in, as soon as no robot stands in the way."""

    x: float
    y: float


class OpenDoor(MessagePart, frozen=True, tag="open"):
    """Open the door again that was closed at the point, m."""

    x: float
    y: float


class Pause(MessagePart, frozen=True, tag="pause"):
    """Begin no further step until Resume."""


class Resume(MessagePart, frozen=True, tag="resume"):
    """Go on after Pause."""


class Step(MessagePart, frozen=True, tag="step"):
    """Go on after Pause, and pause again `steps` steps later."""

    steps: int


class Speed(MessagePart, frozen=True, tag="speed"):
    """Take so many simulated seconds per second from now on, at most; 0: as fast as possible."""

    factor: float


class Stop(MessagePart, frozen=True, tag="stop"):
    """End the run at this step's start."""


Order = (
    Kill | Freeze | Thaw | Restart | Move | StartJam | Lose | Obstacle | Wall
    | Give | CloseDoor | OpenDoor | Pause | Resume | Step | Speed | Stop
)  # fmt: skip
