"""Looks into a robot's core while that is replayed: reads, draws no random number, changes nothing."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from acrc_testbed.replay.run_recordings import recordings, setup_of
from acrc_testbed.trace.knowledge import Tracer, goal_change
from acrc_testbed.trace.rows import (
    Doing,
    GoalChange,
    Held,
    Known,
    ReplicaContact,
    Singles,
    Trace,
    in_words,
    ragged,
    rows,
)
from actors.geometry import CERTAIN, Point, Pose
from actors.instant import Duration, Instant, milliseconds
from actors.messages import DRIVE, NO_ECHO_MM, SENSES, Drive
from actors.portable import arrays
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.node_host import node_of
from actors.robot.behaviour.ports import Goal, GoalPhase, GoalStatus, Plan
from actors.robot.core import RobotCore
from actors.robot.local_planning.steering import BaseLocalPlanner
from actors.robot.localisation import Estimate
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor, load_model
from actors.runtime.core import Core, Inputs, Output, read
from actors.runtime.process_setup import located_model
from actors.task.task import PlaceKey
from deeco.node import Node, looking_on

_PARTICLES: Final = 300
"""So many of the filter's particles are kept: more are a blot."""
_WAY_POINTS: Final = 4
"""Every so manieth point of a plan is kept: they are a cell apart."""
_PHASES: Final = {
    GoalPhase.PLANNING: "planning",
    GoalPhase.CONTROLLING: "driving",
    GoalPhase.OBSTRUCTED: "no trajectory",
    GoalPhase.RETREATING: "backing out",
    GoalPhase.PAUSED: "paused",
}

_TOLD: Final = (
    *("instants", "estimates", "covariances", "lost", "scans", "twists"),
    *("particles_at", "particles", "plans_at", "plans", "costs_at", "costs", "corners"),
)


class Perception:
    """Takes down what one robot perceives and means, closely once in `period`.

    `attach` it to the core before its first step; `taken` is what it has seen, at the end or on the way.
    """

    def __init__(self, robot: str, sensor: RangeSensor, cell: float, period: Duration) -> None:
        """`cell`: of the local cost map, m."""
        self._robot, self._sensor, self._cell, self._period = robot, sensor, cell, period
        angles = sensor.first_angle + sensor.increment * np.arange(sensor.rays)
        self._rays = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
        self._core: RobotCore | None = None
        self._first_step = 0
        self._due: Instant | None = None
        self._now = Instant(0)
        self._estimate = Estimate(Pose(0.0, 0.0, 0.0), CERTAIN)
        self._updated = False
        self._here = Pose(0.0, 0.0, 0.0)
        self._sweep: Sweep | None = None
        self._steered: Instant | None = None
        self._plan: Plan | None = None
        self._cloud: object = None
        self._heard: dict[str, int] = {}
        self._doing: Doing | None = None
        self._known: Known | None = None
        self._goal: Goal | None = None
        self._begin()

    def _begin(self) -> None:
        """Begin new lists."""
        self._told: dict[str, list[Any]] = {name: [] for name in _TOLD}
        self._doings: list[Doing] = []
        self._knowledge: list[Known] = []
        self._contacts: list[ReplicaContact] = []
        self._held: list[tuple[int, Estimate]] = []
        """By step."""
        self._goals: list[GoalChange] = []

    def attach(self, core: Any, step_us: int) -> None:
        """Look at every step that the core takes from now on."""
        assert isinstance(core, RobotCore)
        self._core, self._first_step, self._goal = core, core.step, core.navigation.goal
        advance, update = core.advance, core.localisation.update

        def watched(inputs: Inputs) -> Sequence[Output]:
            outputs = advance(inputs)
            if not core.finished:
                self._now = Instant(read(inputs, SENSES, self._robot).instant)
                self._stand(core.step - 1)
                self._step(outputs)
            return outputs

        def noted(here: Pose, sweep: Sweep | None) -> Estimate:
            self._estimate, self._here = update(here, sweep), here
            self._updated = True
            self._sweep = self._sweep if sweep is None else sweep
            return self._estimate

        cast(Any, core).advance = watched
        cast(Any, core.localisation).update = noted

    @property
    def has_looked(self) -> bool:
        """There was a close look since `taken`."""
        return bool(self._told["instants"])

    def taken(self) -> dict[str, Any]:
        """What it has seen since the last call, by field of a trace."""
        found = self._taken()
        self._begin()
        return found

    def _taken(self) -> dict[str, Any]:
        told = self._told
        side = told["costs"][0].shape if told["costs"] else (1, 1)  # of none numpy cannot count the windows
        return {
            "robot": self._robot,
            "first_step": self._first_step,
            "instants": np.array(told["instants"], np.int64),
            "estimates": np.array(told["estimates"], np.float64).reshape(-1, 3),
            "covariances": np.array(told["covariances"], np.float64).reshape(-1, 3),
            "lost": np.array(told["lost"], np.float64),
            "scans": ragged(told["scans"]),
            "particles_at": np.array(told["particles_at"], np.int64),
            "particles": ragged(told["particles"]),
            "plans_at": np.array(told["plans_at"], np.int64),
            "plans": ragged(told["plans"]),
            "twists": np.array(told["twists"], np.float64).reshape(-1, 2),
            "cell": self._cell,
            "costs_at": np.array(told["costs_at"], np.int64),
            "costs": np.array(told["costs"], np.uint8).reshape(len(told["costs"]), *side),
            "corners": np.array(told["corners"], np.float64).reshape(-1, 3),
            "doings": tuple(self._doings),
            "knowledge": tuple(self._knowledge),
            "contacts": tuple(self._contacts),
            "held": _held(self._held),
            "goals": tuple(self._goals),
        }

    def _step(self, outputs: Sequence[Output]) -> None:
        """What happens seldom is looked for in every step, the rest where it is due."""
        node = node_of(self._robot_core.behaviour)
        knowledge: Any = None
        if node is not None:
            with suppress(KeyError):  # a component of another name than its robot's
                knowledge = node.knowledge(self._robot)
            self._meet(node)
        self._do(knowledge)
        if self._due is not None and self._now < self._due:
            return
        self._due = Instant((self._now // self._period + 1) * self._period)
        self._sample(outputs)
        if knowledge is not None:
            self._know(knowledge)

    def _stand(self, step: int) -> None:
        """Where it held itself to be when a step began, and how its goal stands at its end."""
        if self._updated:
            self._held.append((step, self._estimate))
            self._updated = False
        goal = self._robot_core.navigation.goal
        if goal != self._goal:
            self._goals.append(goal_change(step, goal))
            self._goal = goal

    @property
    def _robot_core(self) -> RobotCore:
        assert self._core is not None
        return self._core

    def _sample(self, outputs: Sequence[Output]) -> None:
        told, estimate = self._told, self._estimate
        told["instants"].append(self._now)
        told["estimates"].append(tuple(estimate.pose))
        covariance = estimate.covariance
        told["covariances"].append((covariance[0], covariance[1], covariance[4]))
        told["lost"].append(estimate.lost)
        told["scans"].append(self._scan())
        drive = next((one.message for one in outputs if one.address.topic is DRIVE), None)
        told["twists"].append((drive.vx, drive.omega) if isinstance(drive, Drive) else (0.0, 0.0))
        self._follow()
        self._scatter()
        self._weigh()

    def _scan(self) -> Singles:
        """Where the last sweep met something, map frame."""
        if self._sweep is None:
            return np.zeros((0, 2), np.float32)
        ranges = self._sweep.ranges_mm
        met = (ranges != NO_ECHO_MM) & (ranges >= 1000 * self._sensor.range_min)
        correction = self._estimate.pose.frame(self._here)
        eye = correction.compose(self._sweep.pose).compose(self._sensor.mount)
        ends = self._rays[met] * (ranges[met, None] / 1000.0)
        return _placed(ends, eye)

    def _follow(self) -> None:
        """The plan, where it is another one."""
        plan = self._robot_core.navigation.plan
        if plan is self._plan:
            return
        self._plan = plan
        way = np.zeros((0, 2)) if plan is None else plan.way
        kept = np.concatenate((way[::_WAY_POINTS], way[-1:]))
        self._told["plans_at"].append(self._now)
        self._told["plans"].append(kept.astype(np.float32))

    def _scatter(self) -> None:
        """The particles, where there are others."""
        particles = getattr(self._robot_core.localisation, "particles", None)
        if particles is None:
            return
        some = particles[:: -(-len(particles) // _PARTICLES), :2].astype(np.float32)
        if isinstance(self._cloud, np.ndarray) and np.array_equal(some, self._cloud):
            return
        self._cloud = some
        self._told["particles_at"].append(self._now)
        self._told["particles"].append(some)

    def _weigh(self) -> None:
        """The costs by which the robot steers now."""
        planner = self._robot_core.navigation.local_planner
        if not isinstance(planner, BaseLocalPlanner) or planner.steered == self._steered:
            return
        self._steered, local = planner.steered, planner.local
        corner = Pose(local.corner.column * self._cell, local.corner.row * self._cell, 0.0)
        self._told["costs_at"].append(self._now)
        self._told["costs"].append(local.costs())
        self._told["corners"].append(tuple(self._estimate.pose.frame(self._here).compose(corner)))

    def _meet(self, node: Node) -> None:
        """Which replicas are newer, and which are gone."""
        heard = {one.id: int(one.heard) for one in node.replicas}
        if heard == self._heard:
            return
        for peer, instant in heard.items():
            if self._heard.get(peer) != instant:
                self._contacts.append(ReplicaContact(self._now, peer, Instant(instant)))
        for peer in sorted(self._heard.keys() - heard.keys()):
            self._contacts.append(ReplicaContact(self._now, peer, None))
        self._heard = heard

    def _know(self, knowledge: Any) -> None:
        told = rows(knowledge)
        if self._known is None or self._known.rows != told:
            self._known = Known(self._now, told)
            self._knowledge.append(self._known)

    def _do(self, knowledge: Any) -> None:
        goal = self._robot_core.navigation.goal
        target = getattr(knowledge, "destination", None)
        key = getattr(target, "key", None)
        destination = key if isinstance(key, PlaceKey) else None
        blocked = getattr(knowledge, "is_blocked", None)
        elsewhere = getattr(knowledge, "waypoint", None)
        activity = self._activity(goal, destination, elsewhere, callable(blocked) and bool(blocked()))
        name = "" if destination is None else in_words(destination)
        point = None if goal is None or activity == "idle" else (goal.point.x, goal.point.y)
        last = self._doing
        if last is None or (last.activity, last.destination, last.point) != (activity, name, point):
            self._doing = Doing(self._now, activity, name, point)
            self._doings.append(self._doing)

    def _activity(
        self, goal: Goal | None, destination: PlaceKey | None, elsewhere: Point | None, blocked: bool
    ) -> str:
        """The word for what it does; that which matters most to whoever looks comes first."""
        if blocked:
            return "blocked"
        if goal is None or goal.status is GoalStatus.SUCCEEDED:
            return "idle" if destination is None and elsewhere is None else "planning"
        if goal.status is GoalStatus.ABORTED:
            return "aborted"
        phase = "planning" if goal.phase is None else _PHASES[goal.phase]
        if phase != "driving":
            return phase
        if elsewhere is not None:
            return "elsewhere"
        return "adopted" if destination is not None and destination.owner != self._robot else phase


def _held(rows: Sequence[tuple[int, Estimate]]) -> Held:
    estimates = [estimate for _, estimate in rows]
    spreads = np.array([one.covariance for one in estimates], np.float64).reshape(-1, 9)
    return Held(
        steps=np.array([step for step, _ in rows], np.int64),
        poses=np.array([tuple(one.pose) for one in estimates], np.float64).reshape(-1, 3),
        located=np.array([one.located for one in estimates], np.bool_),
        variances=spreads[:, (0, 4, 8)],
        lost=np.array([one.lost for one in estimates], np.float64),
    )


def _placed(points: Any, frame: Pose) -> Singles:
    """Points of a frame, (k, 2), in the frame that it is given in."""
    c, s = np.cos(frame.heading), np.sin(frame.heading)
    x, y = points[:, 0], points[:, 1]
    placed: Singles = np.column_stack((frame.x + c * x - s * y, frame.y + s * x + c * y)).astype(np.float32)
    return placed


PERIOD: Final = milliseconds(500)
"""Between two close looks: as often as a person can follow."""


class Collector:
    """Collects from one core: `attach` belongs into `Onlook`, all of the replay into `looking`."""

    def __init__(self, out: Path, actor: str) -> None:
        """RecordingError for a recording without a first record."""
        path = recordings(out)[actor]
        setup = setup_of(path, RobotSetup, "a robot")
        sensor = load_model(located_model(setup.model, path.parent), setup.sensor).sensor
        self._perception = Perception(setup.id, sensor, setup.stack.local_map.cell, PERIOD)
        self._tracer = Tracer()

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Nodes that are made meanwhile tell what they do."""
        with looking_on(self._tracer):
            yield

    def attach(self, core: Core, step_us: int) -> None:
        """Look at every step of the core from now on."""
        self._perception.attach(core, step_us)
        self._tracer.prepare(core, step_us)
        self._tracer.orders.attach(cast(RobotCore, core))

    @property
    def has_looked(self) -> bool:
        """There was a close look since the last part."""
        return self._perception.has_looked

    def part(self, fault: str | None = None) -> Trace:
        """What is new since the last part; `fault`: why the robot cannot be followed any further."""
        tracer = self._tracer
        part = Trace(
            **self._perception.taken(),
            changes=tuple(tracer.changes),
            news=tuple(tracer.news),
            orders=tuple(tracer.orders.found),
            has_nodes=tracer.has_nodes,
            fault=fault,
        )
        tracer.changes, tracer.news, tracer.orders.found = [], [], []
        return part
