"""The smallest swarm that obeys the barrier: a caller asks, every answerer answers."""

from collections.abc import Sequence

from actors.messages import DRIVE, SENSES, Drive, Odometry, Senses
from actors.runtime.core import Address, Inputs, Output, at, read, to

AT_REST = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Caller:
    """Sends Senses to all, awaits Drive from all, so many times; then halts everyone."""

    def __init__(self, robots: Sequence[str], steps: int) -> None:
        self.step = 0
        self.finished = False
        self.speeds: list[list[float]] = []
        self._robots = robots
        self._steps = steps
        self._called = False

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Nothing before the call, every answer after it."""
        if not self._called:
            return ()
        return [at(DRIVE, robot) for robot in self._robots if DRIVE.key(robot) not in have]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Call, or take the answers in."""
        if self._called:
            self.speeds.append([read(inputs, DRIVE, robot).vx for robot in self._robots])
            self.step += 1
            self._called = False
            return ()
        halt = self.step == self._steps
        self.finished = halt
        self._called = True
        senses = Senses(self.step, self.step * 1000, 0, AT_REST, 0, None, halt)
        return [to(SENSES, senses, robot) for robot in self._robots]


class Answerer:
    """Answers each call with a speed that depends on the step and on its name."""

    def __init__(self, robot: str) -> None:
        self.step = 0
        self.finished = False
        self._robot = robot

    def missing(self, have: Inputs) -> Sequence[Address]:
        """The call."""
        return () if have else (at(SENSES, self._robot),)

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Answer it."""
        senses = read(inputs, SENSES, self._robot)
        if senses.halt:
            self.finished = True
            return ()
        self.step += 1
        speed = senses.step + len(self._robot) / 10
        return (to(DRIVE, Drive(senses.step, speed, 0.0, 0.0, 0), self._robot),)
