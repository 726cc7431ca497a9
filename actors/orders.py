"""Orders to a running simulation, from a person, a tool or an event of the scenario.

They are sent in `actors.messages.Control`; positions are metres in the map frame, angles radians.
"""

from typing import Any

from actors.topic import MessagePart


class Kill(MessagePart, frozen=True, tag="kill"):
    """Kill the robot's process; its body stays as an obstacle."""

    robot: str


class Freeze(MessagePart, frozen=True, tag="freeze"):
    """Suspend the robot's core."""

    robot: str


class Thaw(MessagePart, frozen=True, tag="thaw"):
    """Resume a frozen robot's core."""

    robot: str


class Restart(MessagePart, frozen=True, tag="restart"):
    """Start a new process for the robot, in a new boot epoch; a running one is killed first."""

    robot: str


class Move(MessagePart, frozen=True, tag="move"):
    """Move the robot's body to another pose."""

    robot: str
    x: float
    y: float
    heading: float


class StartJam(MessagePart, frozen=True, tag="jam"):
    """Switch on a jammer with a range of `radius` m for `duration` µs."""

    x: float
    y: float
    radius: float
    duration: int


class LoseFrame(MessagePart, frozen=True, tag="lose"):
    """Drop the next frame of `sender` that the robot would receive."""

    robot: str
    sender: str


class Obstacle(MessagePart, frozen=True, tag="obstacle"):
    """Place a fixed round obstacle of `radius` m on the floor."""

    x: float
    y: float
    radius: float


class Wall(MessagePart, frozen=True, tag="wall"):
    """Place a fixed straight wall between two points, m; radio passes through it."""

    x: float
    y: float
    to_x: float
    to_y: float


class ItemAssignment(MessagePart, frozen=True, tag="give"):
    """Give further items of the task to the robot, of the task's item type."""

    robot: str
    items: tuple[Any, ...]


class CloseDoor(MessagePart, frozen=True, tag="close"):
    """Close the door at the point, m, as soon as no robot is in it."""

    x: float
    y: float


class OpenDoor(MessagePart, frozen=True, tag="open"):
    """Reopen the door that was closed at the point, m."""

    x: float
    y: float


class Pause(MessagePart, frozen=True, tag="pause"):
    """Pause the run before the next step."""


class Resume(MessagePart, frozen=True, tag="resume"):
    """Continue after Pause."""


class Step(MessagePart, frozen=True, tag="step"):
    """Continue after Pause, and pause again after `steps` steps."""

    steps: int


class Speed(MessagePart, frozen=True, tag="speed"):
    """Limit the speed to `factor` simulated seconds per second; 0: unlimited."""

    factor: float


class Stop(MessagePart, frozen=True, tag="stop"):
    """End the run at the start of this step."""


Order = (
    Kill | Freeze | Thaw | Restart | Move | StartJam | LoseFrame | Obstacle | Wall
    | ItemAssignment | CloseDoor | OpenDoor | Pause | Resume | Step | Speed | Stop
)  # fmt: skip
