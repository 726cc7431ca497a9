"""What one robot was about: where it held itself to be, and its goals; while it is executed again."""

from typing import Any, NamedTuple, cast

from actors.robot.behaviour.goal import Goal
from actors.robot.core import RobotCore
from actors.robot.localisation import Estimate
from actors.runtime.core import Core, Inputs


class Held(NamedTuple):
    """Where the robot held itself to be when a step began."""

    step: int
    estimate: Estimate


class GoalChange(NamedTuple):
    """How its goal stands from this step on; None: it has none."""

    step: int
    goal: Goal | None


class DriveTrace:
    """Takes that down of a robot's core; `prepare` belongs into `Onlook`."""

    def __init__(self) -> None:
        self.held: list[Held] = []
        self.goals: list[GoalChange] = []

    def prepare(self, core: Core, step_us: int) -> None:
        """Look on from now on."""
        assert isinstance(core, RobotCore)
        localisation, advance = core.localisation, core.advance
        update, latest, before = localisation.update, list[Estimate](), [core.navigation.goal]

        def updated(*inputs: Any) -> Estimate:
            latest[:] = [update(*inputs)]
            return latest[0]

        def advanced(inputs: Inputs) -> Any:
            outputs = advance(inputs)
            if core.finished:
                return outputs
            step = core.step - 1
            self.held += [Held(step, one) for one in latest]
            goal = core.navigation.goal
            if goal != before[0]:
                self.goals.append(GoalChange(step, goal))
                before[0] = goal
            return outputs

        cast(Any, localisation).update = updated
        cast(Any, core).advance = advanced
