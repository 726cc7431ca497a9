"""Some robot holds each open place, whatever happens to messages and in whatever order robots act.

A message is what a robot published at some time; any robot may hear any of them at any time, any number of
times, or never: that is loss, delay, repetition and reordering, all at once.
"""

from dataclasses import replace

from hypothesis import example, given, settings
from hypothesis import strategies as st

from acrc_testbed.testing import LoggedNavigation
from actors.geometry import Point
from actors.randomness import generator
from actors.robot.behaviour import AbortReason
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters, ReleasedParameters
from cleaning.place import Assignment
from tests.cleaning.fakes import OPEN, Action, ScriptedSwarm, published

POINTS = tuple(Point(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0))
"""Few points, so that places coincide and robots pass them."""
IMPATIENT = AdaptationParameters(
    attempts=2, no_plan_attempts=1, blocked_checks=0, still_checks=0, most_adopted=1
)
PRESETS = (AdaptationParameters(), ReleasedParameters(), IMPATIENT, replace(IMPATIENT, exchange=False))


class Swarm(ScriptedSwarm[AdaptiveCleaningRobot]):
    def __init__(self, robots: int, places: int, parameters: AdaptationParameters) -> None:
        made = AdaptiveCleaningRobot(id="", position=Point(9.0, 9.0), parameters=parameters)
        names = [f"r{number}" for number in range(robots)]
        routes = [[Assignment(name, n, POINTS[n % 4]) for n in range(places)] for name in names]
        robots_ = [replace(made, id=name, route=tuple(own)) for name, own in zip(names, routes, strict=True)]
        super().__init__(robots_)
        self.navigation = {robot.id: LoggedNavigation() for robot in self.robots}
        self._adoption = DestinationAdoption(
            parameters.adoption_distance, parameters.adoption_checks, parameters.adoption_backoff
        )
        self.remove = AdoptedDestinationRemove(parameters.exchange)
        self._generator = generator(1, "test", "swarm")

    def _publish(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        self.published.append(published(robot, Cleaner))
        return robot

    def _hear(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        peer = self.message(robot, number)
        if peer is None:
            return robot
        if self._adoption.membership(peer, robot):
            robot = self._adoption.at_member(peer, robot, self.now)
        return self._drop(robot, number)

    def _drop(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        peer = self.message(robot, number)
        if peer is None or not self.remove.membership(peer, robot):
            return robot
        return self.remove.at_member(peer, robot, self.now)

    def _adopt(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        """Adopt without checking who is blocked, as any strategy might."""
        peer = self.message(robot, number)
        if peer is None or peer.destination is None:
            return robot
        return robot.adopting(peer.destination, self.now)

    def _choose(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        """Choose any destination of the route, as any strategy might."""
        return robot.heading_for(robot.route[number % len(robot.route)]) if robot.route else robot

    def _move(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return replace(robot, position=POINTS[number % 4])

    def _leave(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return replace(robot, position=Point(9.0, 9.0))

    def _block(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return replace(robot, state=State.BLOCKED, blocked_for=1 + number % 9, still_for=9)

    def _set_destination(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return robot.set_destination(self.monitor, self.now)

    def _detect_blocked(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return robot.detect_blocked()

    def _auto_unblock(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        return robot.auto_unblock(OPEN, self._generator, self.monitor, self.now)

    def _drive(self, robot: AdaptiveCleaningRobot, number: int) -> AdaptiveCleaningRobot:
        navigation = self.navigation[robot.id]
        if navigation.goal is not None and number % 4 < 2:
            navigation.abort((AbortReason.NO_PLAN, AbortReason.BLOCKED)[number % 2])
        return robot.drive(navigation, self.monitor, self.now)

    def check(self) -> None:
        super().check()
        for robot in self.robots:
            assert robot.former is None or robot.former in robot.route
            assert len(robot.adopted) <= robot.parameters.most_adopted


OFTEN = ("publish", "hear", "drop", "adopt", "choose", "set_destination")
SELDOM = ("move", "leave", "block", "detect_blocked", "auto_unblock", "drive")
acts = st.builds(
    Action,
    st.sampled_from(OFTEN * 3 + SELDOM),
    st.integers(0, 4),
    st.one_of(st.integers(0, 3), st.integers(0, 60)),
)


THERE_AND_BACK = [
    *(Action("set_destination", robot, 0) for robot in (0, 1)), Action("publish", 0, 0),
    Action("adopt", 1, 0), Action("publish", 1, 0), Action("drop", 0, 0), Action("adopt", 0, 0),
    Action("publish", 0, 0), Action("drop", 1, 0), Action("drop", 0, 0), Action("drop", 1, 1),
]  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(
    st.integers(2, 5), st.integers(1, 2), st.sampled_from(PRESETS), st.lists(acts, min_size=40, max_size=120)
)
@example(2, 1, PRESETS[0], THERE_AND_BACK)
def test_no_place_is_lost(
    robots: int, places: int, parameters: AdaptationParameters, script: list[Action]
) -> None:
    Swarm(robots, places, parameters).play(script)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 5), st.sampled_from(PRESETS), st.lists(acts, min_size=20, max_size=60))
def test_finally_each_place_is_held_once(
    robots: int, parameters: AdaptationParameters, script: list[Action]
) -> None:
    swarm = Swarm(robots, 1, replace(parameters, most_adopted=10)).play(script)
    swarm.remove = AdoptedDestinationRemove(exchange=False)
    for _ in range(2 * robots):  # no further actions, and all messages arrive
        swarm.published.clear()
        for index in range(robots):
            swarm.act(Action("publish", index, 0))
        for index in range(robots):
            for number in range(robots):
                swarm.act(Action("drop", index, number))
        swarm.check()
    swarm.check_held_once()
