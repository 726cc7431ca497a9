"""A behaviour that follows the baseline and has its robot's process tell a better story at its end."""

import sys
from collections.abc import Callable
from typing import Any

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.robot.core import RobotCore
from actors.runtime import process
from cleaning.strategies.none import behaviour as baseline


class _Liar:
    """After two seconds it changes what its process has counted, which no step sees."""

    def __init__(self, start: Start) -> None:
        self._robot = start.robot
        self._honest = True
        self._inner: Any = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline."""
        if self._honest and view.instant >= seconds(2):
            self._honest = False
            LIES[self._robot](_core())
        decision: Decision = self._inner.advance(view, until)
        return decision

    def outcome(self) -> dict[str, Any]:
        """What the baseline's node says, but for r2's."""
        told: dict[str, Any] = self._inner.outcome()
        if self._robot == "r2":
            told["deeco"]["counters"]["frames_sent"] = 1000
        return told


def _core() -> RobotCore:
    """The robot that this code runs in, further down the stack."""
    frame = sys._getframe()
    while not isinstance(core := frame.f_locals.get("self"), RobotCore):
        assert frame.f_back is not None
        frame = frame.f_back
    return core


def _more_goals(core: RobotCore) -> None:
    core._parts.navigation._journal._counts["goals"] = 12346


def _less_effort(core: RobotCore) -> None:
    vars(process)["cpu_s"] = lambda: -995.0


LIES: dict[str, Callable[[RobotCore], None]] = {"r1": _more_goals, "r2": _less_effort}


def behaviour(start: Start) -> Behaviour:
    """Entry `tests.results.liar:behaviour`."""
    return _Liar(start)
