"""Drawing of one run on a canvas, whole or part by part."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from acrc_testbed.explanation.episodes import ObservedActivity
from acrc_testbed.explanation.time_accounting import cause_intervals
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.floor import door_cells
from acrc_testbed.run_model.frame_outcomes import LOSSES, FrameCopies, outcome_name
from acrc_testbed.run_model.recording_readers import NO_FRAMES
from acrc_testbed.run_model.robot_introspection import (
    NOT_RECORDED,
    ActivityChange,
    RobotInternals,
    StepCommit,
)
from acrc_testbed.run_model.task_state import ItemTable
from acrc_testbed.view.plots import Plots, PositionHistory, RobotLane, RunEventTexts
from actors.array_types import Floats
from actors.installation.usage import wrong_value
from actors.introspection import DecisionRecord
from actors.observer import floor_drawing, layout, panels, robots
from actors.observer.canvas import Canvas
from actors.observer.panels import DrawnEvent, KnowledgeExchange, LaneActivity
from actors.radio.medium.state import Outcome
from actors.runtime.errors import printable

_LINE_S: Final = 0.5
"""Interval between lines to a destination, s."""
_AGE_S: Final = 1.0
"""Interval between points of the plot of replicas' ages, s."""


class ProcessEvents:
    """Event texts of one process of a robot."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._blocked: float | None = None
        self._activity = ""

    def events(self, internals: RobotInternals) -> Iterator[DrawnEvent]:
        """Yield the events of the next part."""
        for one in internals.activities:
            if one.activity == "blocked" and self._blocked is None:
                self._blocked = one.second
                yield DrawnEvent(one.second, self._robot, "is blocked", "WARN")
            elif one.activity != "blocked" and self._blocked is not None:
                lasted = one.second - self._blocked
                yield DrawnEvent(one.second, self._robot, f"free again after {lasted:.0f} s")
                self._blocked = None
            if one.activity == "aborted" and self._activity != "aborted":
                yield DrawnEvent(one.second, self._robot, "navigation aborts its goal", "ERROR")
            self._activity = one.activity
        for change, decision in internals.decisions():
            commit = change.commit
            source = f" from {commit.peer}, {commit.age / 1e6:.1f} s old" if commit.peer else ""
            words = f"{decision.words} ({commit.by.partition('.')[0]}{source})"
            yield DrawnEvent(change.second, self._robot, words, "WARN")


class ProcessDrawing:
    """Drawing of one robot process's introspection, part by part."""

    def __init__(
        self,
        canvas: Canvas,
        robot: str,
        path: PositionHistory,
        lane: RobotLane,
        *,
        is_detailed: bool,
        has_goals: bool,
    ) -> None:
        """`is_detailed`: draw perception; `has_goals`: draw goals."""
        self._canvas, self._robot, self._path, self._lane = canvas, robot, path, lane
        self._is_detailed, self._has_goals = is_detailed, has_goals
        self._events = ProcessEvents(robot)
        self._last: list[ActivityChange] = []
        self._line_due: float | None = None
        self._age_times: dict[str, tuple[float, float]] = {}
        """By peer: next time of the plot of its age, and last reception, s."""
        if is_detailed:
            panels.set_perception_style(canvas, robot)

    def draw(self, internals: RobotInternals, end: float | None = None) -> Iterator[KnowledgeExchange]:
        """Draw the next part, and yield exchanges with others. `end`: end of the run, if nothing follows."""
        canvas, robot = self._canvas, self._robot
        until = internals.end if end is None else end
        if self._is_detailed:
            _draw_perception(canvas, robot, internals)
            panels.draw_decisions(canvas, robot, [_causes(*one) for one in internals.decisions()])
            self._draw_ages(internals, until)
        activities = [LaneActivity(one.second, one.activity, one.destination) for one in internals.activities]
        self._lane.draw_activities(activities, until)
        panels.draw_knowledge(canvas, robot, list(internals.knowledge))
        if self._has_goals:
            self._draw_goals(internals.activities, internals.end)
        panels.draw_events(canvas, "inside", list(self._events.events(internals)))
        for one, _ in internals.decisions():
            if one.commit.peer:
                yield KnowledgeExchange(one.second, one.commit.by.partition(".")[0], one.commit.peer, robot)

    def _draw_goals(self, activities: Sequence[ActivityChange], until: float) -> None:
        """Draw the robot's goal twice a second."""
        known = [*self._last, *activities]
        if not known:
            return
        begins = np.array([one.second for one in known], np.float64)
        points = np.array([one.point or (np.nan, np.nan) for one in known], np.float64)
        first = begins[0] if self._line_due is None else self._line_due
        lines = np.arange(first, until, _LINE_S)
        self._line_due = float(first + len(lines) * _LINE_S)
        self._last = known[-1:]
        seconds = np.union1d(lines, begins if len(known) == len(activities) else begins[1:])
        if not len(seconds):
            return
        there = points[np.maximum(np.searchsorted(begins, seconds, side="right") - 1, 0)]
        floor_drawing.draw_goals(self._canvas, self._robot, seconds, self._path.at(seconds), there)

    def _draw_ages(self, internals: RobotInternals, until: float) -> None:
        """Draw the ages of replicas."""
        canvas, robot = self._canvas, self._robot
        for peer in dict.fromkeys((*self._age_times, *(one.peer for one in internals.contacts))):
            intervals = [one for one in internals.contacts if one.peer == peer]
            begins = np.array([one.second for one in intervals], np.float64)
            receptions = np.array(
                [np.nan if one.heard is None else one.heard for one in intervals], np.float64
            )
            path = f"plots/ages/{peer}_at_{robot}"
            if peer not in self._age_times:
                panels.set_line_style(canvas, path, f"{peer} at {robot}", canvas.colour(peer))
                self._age_times[peer] = float(begins[0]), np.nan
            due, last = self._age_times[peer]
            begins, receptions = np.concatenate(([-np.inf], begins)), np.concatenate(([last], receptions))
            seconds = np.arange(due, until, _AGE_S)
            ages = seconds - receptions[np.searchsorted(begins, seconds, side="right") - 1]
            known = np.isfinite(ages)
            panels.draw_line(canvas, path, seconds[known], ages[known])
            self._age_times[peer] = due + len(seconds) * _AGE_S, float(receptions[-1])


def _causes(change: StepCommit, decision: DecisionRecord) -> tuple[float, Sequence[str]]:
    """Return the time of a decision, the decision and its recorded causes."""
    commit = change.commit
    causes = [f"{decision.words}, by {commit.by}"]
    if commit.peer:
        causes.append(f"knowledge of {commit.peer}, {commit.age / 1e6:.1f} s old")
    if (used := commit.replica) is not None:
        relayed = f", relayed {used.hops} times" if used.hops else ""
        strength = "" if used.rssi_dbm is None else f", {used.rssi_dbm:.0f} dBm"
        causes.append(f"publication {used.publication}{relayed}{strength}")
    causes += [f"{one.path}: {one.before} → {one.after}" for one in commit.changed]
    return change.second, causes


def _draw_perception(canvas: Canvas, robot: str, internals: RobotInternals) -> None:
    """Draw scan, particles, estimate, costs, plan and arc."""
    for kind, sets in (("scan", internals.scans), ("particles", internals.particles)):
        panels.draw_clouds(canvas, robot, kind, sets.seconds, sets.counts, sets.points)
    panels.draw_estimates(canvas, robot, internals.seconds, internals.estimates, internals.covariances)
    panels.draw_arcs(canvas, robot, internals.seconds, internals.estimates, internals.twists)
    panels.draw_plans(canvas, robot, internals.plans.seconds, internals.plans.sets())
    windows = internals.windows
    panels.draw_costs(canvas, robot, windows.seconds, windows.costs, windows.corners, windows.cell)


DETAILED: Final = 8
"""Default number of robots drawn in detail; scans and particles of fifty would take gigabytes."""
_LASTING: Final = 10.0
"""How long an exchange is shown in the graph of ensembles, s."""


class RunDrawing:
    """Drawing of one run, whole or part by part."""

    def __init__(self, canvas: Canvas, run: RunData, detailed: Sequence[str]) -> None:
        """`detailed`: robots drawn in detail."""
        self._canvas, self._detailed = canvas, frozenset(detailed)
        self._selected = self._detailed if len(detailed) < DETAILED else frozenset[str]()
        """Robots with all links, goals and adoptions drawn even among many robots."""
        self._paths = {robot: PositionHistory() for robot in run.robots}
        self._trails = {robot: robots.DrawnTrail() for robot in run.robots}
        self._lanes = {robot: RobotLane(canvas, robot) for robot in run.robots}
        self._insides: dict[str, ProcessDrawing] = {}
        """By actor."""
        self._recorded: set[str] = set()
        """Robots whose introspection is recorded."""
        self._outside = {robot: ObservedActivity(robot) for robot in run.robots}
        self._items = ItemTable()
        description = run.description
        self._plots = Plots(canvas, true=description.has_truth, batteries=description.has_batteries)
        self._event_texts = RunEventTexts()
        self._received: Floats = np.zeros((0, 4))
        """Recently received frames, as in `RunData.heard`."""
        self._lost: list[tuple[float, int, str]] = []
        """Recently lost copies."""
        self._copies_since = 0.0
        self._exchanges: list[KnowledgeExchange] = []
        floor_drawing.draw_floor(canvas, run.grid, door_cells(run.grid, run.description.radius))
        floor_drawing.draw_legend(canvas, run.description.task)
        floor_drawing.draw_outcome_legend(canvas)
        robots.set_radio_style(canvas)
        for robot in run.robots:
            robots.draw_body(canvas, robot)
            floor_drawing.set_goal_style(canvas, robot)

    def draw_recorded(self, run: RunData) -> None:
        """Draw robots, trails, items, links, plots and events."""
        canvas = self._canvas
        for robot, track in run.trajectories.items():
            known = np.isfinite(track.poses[:, 0])
            seconds, poses = track.seconds[known], track.poses[known]
            self._paths[robot].extend(seconds, poses)
            robots.draw_poses(canvas, robot, seconds, poses)
            robots.draw_trail(canvas, robot, seconds, poses[:, :2], self._trails[robot])
            for second, state in track.states:
                robots.draw_name(canvas, robot, second, state)
            self._lanes[robot].draw_states(track.states)
        if run.people.size:
            robots.draw_people(canvas, run.seconds, run.people)
        for second, objects in run.floor:
            floor_drawing.draw_things(canvas, second, objects)
        self._draw_items(run)
        self._draw_links(run)
        self._plots.extend(run)
        panels.draw_events(canvas, "recorded", list(self._event_texts.events(run)))
        self._draw_adoptions(run)

    def draw_copies(self, copies: FrameCopies, until: float, *, last: bool) -> None:
        """Draw outcomes of frames up to an instant, s: rings at losses, and counts by outcome.

        `last`: nothing will follow.
        """
        canvas = self._canvas
        rows = zip(copies.seconds.tolist(), copies.receivers.tolist(), copies.outcomes.tolist(), strict=True)
        self._lost += [
            (s, receiver, outcome_name(Outcome(one))) for s, receiver, one in rows if Outcome(one) in LOSSES
        ]
        shown = robots.shown_s(canvas)
        seconds = _multiples(robots.period(canvas), max(0.0, self._copies_since - shown), until)
        robots.draw_losses(canvas, seconds, self._positions(seconds), self._lost, self._copies_since)
        self._copies_since = until
        self._lost = [one for one in self._lost if one[0] > until - shown - robots.period(canvas)]
        self._plots.add_copies(copies, until, last=last)

    def draw_computed(self, run: RunData, *, last: bool = False) -> None:
        """Draw frame outcomes and introspection, after `draw_recorded`; `last`: nothing will follow."""
        end = run.end if last else None
        if run.description.records_frames:
            self.draw_copies(run.copies, run.end, last=last)
        if last and not run.since and run.records_floor and (run.out / "run.json").is_file():
            self._draw_deadlocks(run)
        self._recorded |= {one.process.robot for one in run.internals if one.is_recorded}
        known = len(self._exchanges)
        for internals in run.internals:
            if internals.is_recorded:
                self._draw_internals(internals, end)
        begin = min([run.since, *(one.second for one in self._exchanges[known:])])
        for robot, activity in self._outside.items():
            changes = [LaneActivity(*one) for one in activity.extend(run.trajectories[robot], run.routes)]
            if robot not in self._recorded:
                self._lanes[robot].draw_activities(changes, run.end)
        self._draw_ensembles(begin)
        if last:
            for lane in self._lanes.values():
                lane.end(run.end)

    def missing_data(self, run: RunData) -> list[str]:
        """Return sentences about missing data of a whole run."""
        found = [NO_FRAMES] if run.description.has_truth and not run.description.records_frames else []
        return found + [
            f"{one.process.actor}: {NOT_RECORDED}" for one in run.internals if not one.is_recorded
        ]

    def _draw_internals(self, internals: RobotInternals, end: float | None) -> None:
        robot, actor = internals.process.robot, internals.process.actor
        if actor not in self._insides:
            self._insides[actor] = ProcessDrawing(
                self._canvas,
                robot,
                self._paths[robot],
                self._lanes[robot],
                is_detailed=robot in self._detailed,
                has_goals=self._is_full(robot),
            )
        self._exchanges += self._insides[actor].draw(internals, end)

    def _draw_deadlocks(self, run: RunData) -> None:
        """Draw deadlocks by ground truth."""
        found: dict[str, list[tuple[float, float]]] = {}
        for one in cause_intervals(run):
            if one.cause == Cause.DEADLOCK:
                found.setdefault(one.robot, []).append((one.begin, one.end))
        for robot, intervals in found.items():
            self._lanes[robot].deadlocks = intervals
        source = [DrawnEvent(begin, robot, "is in a deadlock", "ERROR") for robot, intervals in found.items()
                for begin, _ in intervals]  # fmt: skip
        panels.draw_events(self._canvas, "truth", source)

    def draw_notices(self, events: Sequence[DrawnEvent]) -> None:
        """Draw events about the view itself, such as missing data."""
        panels.draw_events(self._canvas, "view", events)

    def _draw_ensembles(self, since: float) -> None:
        """Draw the graph of exchanges from an instant on, s."""
        panels.draw_ensembles(self._canvas, self._exchanges, _LASTING, since)
        self._exchanges = [one for one in self._exchanges if one.second + 2 * _LASTING > since]

    def _draw_items(self, run: RunData) -> None:
        """Draw an owner's items at each change of their state."""
        for change in self._items.extend(run):
            for owner in sorted({key.owner for key in change.states}):
                items = [state for key, state in self._items.states.items() if key.owner == owner]
                floor_drawing.draw_items(self._canvas, run.description.task, owner, change.second, items)

    def _draw_links(self, run: RunData) -> None:
        canvas = self._canvas
        received = np.concatenate((self._received, run.heard))
        self._received = received[received[:, 0] > run.end - 2 * robots.LASTING]
        seconds = _multiples(robots.period(canvas), run.since, run.end)
        robots.draw_links(canvas, seconds, self._positions(seconds), received, self._selected)

    def _positions(self, seconds: Floats) -> Floats:
        """Return the robots' positions, (n, robots, 2), m."""
        return np.stack([path.at(seconds) for path in self._paths.values()], axis=1)

    def _is_full(self, robot: str) -> bool:
        """Return True if goals and adoptions of a robot are drawn: all of few robots, chosen ones of many."""
        return self._canvas.is_small_swarm or robot in self._selected

    def _draw_adoptions(self, run: RunData) -> None:
        for event in run.taken_over:
            state = self._items.states.get(event.key)
            if self._is_full(event.robot) and state is not None:
                x, y = self._paths[event.robot].at(np.array([event.second]))[0].tolist()
                floor_drawing.draw_adoption(
                    self._canvas, event.robot, event.second, (x, y), state[:2], printable(str(event.key))
                )


def detailed_robots(robots: Sequence[str], requested: Sequence[str]) -> list[str]:
    """Return the robots to draw in detail: the requested ones, else the first DETAILED.

    Raises OptionError for an unknown robot.
    """
    for robot in requested:
        if robot not in robots:
            raise wrong_value("--robot", robot, f"one of {', '.join(robots)}")
    return [robot for robot in robots if robot in requested] or list(robots[:DETAILED])


def arrangement(run: RunData, detailed: Sequence[str]) -> layout.ViewerContents:
    """Return the arrangement of the window for a run."""
    description = run.description
    return layout.ViewerContents(
        run.grid, run.robots, detailed, run.end, description.has_truth, description.has_batteries,
        printable(description.task.items),
    )  # fmt: skip


def _multiples(period: float, since: float, end: float) -> Floats:
    """Return the multiples of a period from `since` to before `end`, (n,), s."""
    first, last = (int(np.ceil(second / period - 1e-9)) for second in (since, end))
    return np.arange(first, max(first, last)).astype(np.float64) * period
