"""The processes of a robot with a ROS 2 base, with injected faults of processes and topics."""

from contextlib import suppress
from pathlib import Path
from typing import Self

from tests.onboard.standstill_rig import FLEET, NotDrivingError, Rig, Where
from tests.ros2.emulation import TurtlebotProcess, robots_world

ROS2_GUARDIAN = "firmware_bridge.ros2.guardian"
_SPEEDS = {"turtlebot4": 0.28, "turtlebot3_burger": 0.2}


class Ros2Rig(Rig):
    """An emulated TurtleBot 4 or 3, and the processes that drive it."""

    def __init__(self, folder: Path, model: str) -> None:
        super().__init__(folder)
        self.fast = _SPEEDS[model]
        self._robots = TurtlebotProcess(folder, robots_world([model]))
        lines = [line for line in FLEET.splitlines() if not line.startswith(("base", "range"))]
        self.fleet = "\n".join(
            [
                *lines,
                f'model = "{model}"',
                "[robot.base]",
                'kind = "ros2"',
                f'router = "{self._robots.router}"',
                'namespace = "/r1"\n',
            ]
        )

    def __enter__(self) -> Self:
        self._robots.__enter__()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._robots.__exit__(*error)

    def expect_ok(self, line: str) -> None:
        """Inject a fault. Raises NotDrivingError if it is refused."""
        if (answer := self._robots.ask(line)) != "ok":
            raise NotDrivingError(f"{line}: {answer}")

    def processes(self, word: str) -> list[int]:
        """Return the robot's processes with this word; the guardian's command line has the router."""
        if word != ROS2_GUARDIAN:
            return super().processes(word)
        found = []
        for entry in Path("/proc").glob("[0-9]*/cmdline"):
            with suppress(OSError):
                words = entry.read_bytes().decode(errors="replace").split("\0")
                if word in words and any(self._robots.router in one for one in words):
                    found.append(int(entry.parent.name))
        return found

    def where(self) -> Where:
        """Return the ground truth."""
        time_s, travelled, speed, stands = self._robots.where("r1")
        return Where(time_s, travelled, 0.0 if speed < 1e-3 else speed, float(stands))
