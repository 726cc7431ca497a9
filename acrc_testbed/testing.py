"""Floor, ports, radio and virtual time for tests of strategies, without a run.

`VirtualSwarm` advances the behaviours of one strategy together on a `LossyMedium` of `deeco.virtual_network`,
whose `VirtualNetwork` does the same for nodes of the component model. `TextFloor`, `LoggedNavigation` and
`ScriptedPositioning` can also be passed to a single process or ensemble. Nothing moves by itself: the test
decides when a goal is reached or aborted. Lengths are in m in the map frame, angles in rad, instants and
durations in µs.
"""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import CERTAIN, Covariance, Point, Pose
from actors.instant import START, Instant, in_seconds
from actors.items import ItemGivenUp, ItemKey, plain_items
from actors.messages import FrameReceived, FrameSent, OutgoingFrame, RadioEvent
from actors.randomness import generator
from actors.robot.behaviour import (
    AbortReason,
    Behaviour,
    Goal,
    GoalOrder,
    GoalPhase,
    GoalStatus,
    Plan,
    Start,
    View,
)
from actors.robot.behaviour.decisions import RobotLimits, fault
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.node_host import node_of
from actors.robot.navigation.planning import planning_grid
from actors.robot.navigation.routes import ReachableFloor
from actors.runtime.errors import AcrcError
from deeco import Knowledge
from deeco.link import Reception
from deeco.virtual_network import LossyMedium as LossyMedium  # noqa: PLC0414  # re-exported
from deeco.virtual_network import VirtualNetwork as VirtualNetwork  # noqa: PLC0414

_SIGNS: Final = {".": FREE, "#": OCCUPIED, "?": UNKNOWN, " ": UNKNOWN}


class TextFloor(ReachableFloor):
    """A floor plan drawn with characters; `floor["a"]` is the centre of the character a, m."""

    points: Mapping[str, Point]
    """Centres of named characters, m, from the south-west."""

    def __getitem__(self, name: str) -> Point:
        return self.points[name]

    def plan_of(self, start: Point, rng: Generator) -> ReachableFloor:
        """Return the floor plan of a robot that starts at `start`; random places are drawn from `rng`."""
        return ReachableFloor(self._floor, self._radius, start, (), rng)


def floor(
    text: str, metres: float = 1.0, *, origin: tuple[float, float] = (0.0, 0.0), radius: float = 0.177
) -> TextFloor:
    """Return a floor plan from lines of characters, north first, each `metres` ≥ 0.05 wide and high.

    `.` is free floor, `#` a wall, `?` and space are unknown and closed to robots. Any other character is free
    floor and names a point; random places are reachable from the first of them, in the south-west. `origin`:
    south-west corner, m. `radius`: of the robots' bodies, m; default: a TurtleBot 2. Raises AcrcError for a
    name of two points, for one where no robot can stand, and for a floor without any.
    """
    lines = textwrap.dedent(text).strip("\n").splitlines()[::-1]
    cells = np.full((len(lines), max(map(len, lines), default=0)), UNKNOWN, np.uint8)
    points, (west, south) = dict[str, Point](), origin
    for row, line in enumerate(lines):
        for column, sign in enumerate(line):
            cells[row, column] = _SIGNS.get(sign, FREE)
            if sign in points:
                raise AcrcError(
                    f"the floor has two points {sign!r}; use another character, or . for free floor"
                )
            if sign not in _SIGNS:
                points[sign] = Point(west + (column + 0.5) * metres, south + (row + 0.5) * metres)
    if not points:
        raise AcrcError("the floor has no named point; draw a letter where a robot starts")
    count = round(metres / 0.05)  # cells of the shipped maps are 0.05 m wide
    plan = OccupancyGrid(cells.repeat(count, 0).repeat(count, 1), metres / count, Point(west, south))
    grid = planning_grid(plan, radius)
    for sign, point in points.items():
        if not grid.grid.is_free(point):
            raise AcrcError(
                f"point {sign!r} of the floor is within {grid.reach:g} m of a wall; "
                f"move it, or use more than {metres:g} m per character"
            )
    drawn = TextFloor(grid, radius, next(iter(points.values())), (), generator(1, "test", "floor"))
    drawn.points = points
    return drawn


@dataclass
class ScriptedPositioning:
    """Pose estimate that the test sets."""

    pose: Pose
    moving: bool = False
    covariance: Covariance = CERTAIN
    lost_probability: float = 0.0
    peers: tuple[Point, ...] | None = None
    """Positions of other robots, m, as last disregarded; None before."""
    relocalised: int = 0
    """Number of requests to search the whole map."""

    def disregard(self, peers: Sequence[Point]) -> None:
        """Store the positions of other robots."""
        self.peers = tuple(peers)

    def relocalise(self) -> None:
        """Count the request."""
        self.relocalised += 1


@dataclass
class LoggedNavigation:
    """Navigation that logs its commands; the test ends a goal by `succeed` or `abort`."""

    goal: Goal | None = None
    plan: Plan | None = None
    """None unless the test sets it; reset with the goal."""
    backing_out: bool = False
    """True from `back_out` until the test resets it."""
    commands: list[tuple[str, Point | float | None]] = field(default_factory=list)
    """Method and argument of each command, such as `("go_to", point)` and `("stop", None)`."""
    now: Instant = START
    """Instant of the next command; `VirtualSwarm` sets it."""

    @property
    def goals(self) -> list[Point]:
        """Points of all commands `go_to`, in order."""
        return [argument for _, argument in self.commands if isinstance(argument, Point)]

    def go_to(self, point: Point) -> None:
        """Set the goal."""
        self.commands.append(("go_to", point))
        self.plan, self.goal = None, Goal(point, GoalStatus.ACTIVE)
        self._enter(GoalPhase.CONTROLLING)

    def stop(self) -> None:
        """Clear the goal."""
        self.commands.append(("stop", None))
        self.goal = self.plan = None
        self.backing_out = False

    def pause(self) -> None:
        """Pause and keep the goal."""
        self.commands.append(("pause", None))
        self._enter(GoalPhase.PAUSED)

    def resume(self) -> None:
        """Continue to the goal."""
        self.commands.append(("resume", None))
        self._enter(GoalPhase.CONTROLLING)

    def back_out(self, distance: float) -> None:
        """Start to back out."""
        self.commands.append(("back_out", distance))
        self.backing_out = True

    def obstruct(self) -> None:
        """Stand without a valid trajectory: blocked, but not yet aborted."""
        self._enter(GoalPhase.OBSTRUCTED)

    def succeed(self) -> None:
        """End the goal as reached; the pose stays."""
        self._end(GoalStatus.SUCCEEDED)

    def abort(self, reason: AbortReason = AbortReason.BLOCKED) -> None:
        """End the goal as aborted."""
        self._end(GoalStatus.ABORTED, reason)

    def _enter(self, phase: GoalPhase) -> None:
        if self.goal is not None and self.goal.status is GoalStatus.ACTIVE:
            self.goal = self.goal._replace(phase=phase, since=self.now)

    def _end(self, status: GoalStatus, reason: AbortReason | None = None) -> None:
        assert self.goal is not None, "navigation has no goal"
        self.goal, self.plan = Goal(self.goal.point, status, reason), None


class VirtualRobot:
    """One robot of a `VirtualSwarm`: its behaviour, its ports, and what the behaviour has reported."""

    def __init__(self, start: Start, behaviour: Behaviour) -> None:
        self.start, self.behaviour, self.now = start, behaviour, START
        self.positioning = ScriptedPositioning(start.pose)
        self.navigation = LoggedNavigation()
        self.battery: float | None = None
        """Charge, 0 to 1; None: unknown."""
        self.is_frozen = False
        """True: the behaviour is not advanced; frames wait."""
        self.reports: list[Any] = []
        self.given_up: list[ItemGivenUp] = []
        self.route = tuple(ItemKey(start.robot, index) for index in range(len(start.items)))
        """Remaining items as last reported; initially those of the start."""
        self._events: list[RadioEvent] = []

    @property
    def knowledge(self) -> Knowledge:
        """Knowledge of the component that `host` runs."""
        node = node_of(self.behaviour)
        assert node is not None
        return node.knowledge(self.start.robot)

    def reach_goal(self) -> None:
        """Move to the goal and end it as reached."""
        self.navigation.succeed()
        self.positioning.pose = Pose(*self.navigation.goals[-1], 0.0)

    def advance(self, until: Instant, received: Sequence[Reception]) -> tuple[OutgoingFrame, ...]:
        """Advance the behaviour by a step and apply its decision. Raises BehaviourError for a wrong one."""
        self._events += (
            FrameReceived(one.instant, one.sender, one.rssi_dbm or 0.0, 255, one.data) for one in received
        )
        now, self.now = self.now, until
        if self.is_frozen:
            return ()
        base, navigation = self.positioning, self.navigation
        navigation.now = now
        view = View(
            now,
            base.pose,
            base.moving,
            navigation.goal,
            tuple(sorted(self._events, key=lambda event: event.instant)),
            covariance=base.covariance,
            lost=base.lost_probability,
            plan=navigation.plan,
            backing_out=navigation.backing_out,
            battery=self.battery,
        )
        decision = self.behaviour.advance(view, until)
        if wrong := fault(decision, now, until, RobotLimits()):
            raise BehaviourError(f"{in_seconds(now):g} s: the behaviour of {self.start.robot} {wrong}")
        self._events = [FrameSent(frame.instant, frame.tag) for frame in decision.frames]
        self.reports += decision.reports
        self.given_up += decision.given_up
        if decision.route is not None:
            self.route = decision.route
        if decision.peers is not None:
            base.disregard(decision.peers)
        if decision.relocalise:
            base.relocalise()
        if isinstance(decision.goal, Point):
            navigation.go_to(decision.goal)
        elif decision.goal is GoalOrder.CANCEL:
            navigation.stop()
        if decision.paused is not None:
            (navigation.pause if decision.paused else navigation.resume)()
        if decision.back_out is not None:
            navigation.back_out(decision.back_out)
        return decision.frames


class VirtualSwarm(VirtualNetwork[VirtualRobot]):
    """Robots with one strategy, advanced together in virtual time; `swarm["r1"]` is a robot."""

    def __init__(
        self,
        strategy: Callable[[Start], Behaviour],
        floor: TextFloor,
        robots: Mapping[str, Sequence[Any]],
        medium: LossyMedium | None = None,
        *,
        seed: int = 1,
        **fields: Any,
    ) -> None:
        """Create robots by id, each with the point of its start and its items.

        A point is a name on the floor or a Point: `{"r1": "abc"}` starts at a, with the points b and c as
        items; other values are items as they are. `seed`: of the behaviours. `fields`: further fields of
        Start, such as `settings` and `exchange`.
        """
        members = {name: address for address, name in enumerate(robots, start=1)}
        swarm = dict[str, VirtualRobot]()
        for name, points in robots.items():
            here, *items = (floor[one] if isinstance(one, str) else one for one in points)
            rng = generator(seed, "behaviour", name)
            plan = floor.plan_of(here, rng)
            start = Start(
                name,
                members[name],
                0,
                Pose(here.x, here.y, 0.0),
                plain_items(items),
                rng,
                floor=plan,
                members=members,
            )
            start = replace(start, **fields)
            swarm[name] = VirtualRobot(start, strategy(start))
        super().__init__(swarm, medium)
