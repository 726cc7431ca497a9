"""The run model: accumulates the messages of a run into columns, items, floor and events."""

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter, itemgetter
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

from acrc_testbed.recordings.run_recordings import RecordedOrder
from acrc_testbed.run_model.data import (
    RunData,
    RunDataError,
    RunDescription,
    Trajectory,
    step_columns,
)
from acrc_testbed.run_model.floor import FLOOR_ORDERS, NO_CHANGES, FloorHistory
from acrc_testbed.run_model.frame_outcomes import FrameCopies, frame_copies
from acrc_testbed.run_model.robot_introspection import RecordedProcess
from acrc_testbed.run_model.task_state import ItemReports
from actors.instant import in_seconds
from actors.message_limits import OrderLimits, order_fault
from actors.messages import (
    Control,
    Drive,
    FloorChanged,
    FrameOutcomes,
    FrameReceived,
    ItemMark,
    RadioAdvanced,
    RadioEvents,
    TaskChanged,
    TaskEvent,
    Truth,
)
from actors.topic import Message

T = TypeVar("T", bound=Any)
_ROUNDING: Final = 1e-6
"""Tolerance of comparisons of instants, s."""


def robot_of(key: str) -> str:
    """Return the robot of a key such as `swarm/up/ID/drive`; "" for other keys."""
    parts = key.split("/")
    return parts[2] if len(parts) == 4 and parts[1] in ("up", "down") else ""


def convert_instants(message: Message, convert: Callable[[int], int]) -> Message:
    """Return a robot's message with the instants of its items given up and radio events converted, µs."""

    def converted(parts: Sequence[T]) -> tuple[T, ...]:
        return tuple(msgspec.structs.replace(one, instant=convert(one.instant)) for one in parts)

    match message:
        case Drive():
            return msgspec.structs.replace(message, given_up=converted(message.given_up))
        case RadioEvents():
            return msgspec.structs.replace(message, events=converted(message.events))
    return message


def _people(truths: Sequence[Truth]) -> Any:
    """Return `RunData.people`. Raises RunDataError if their number changes."""
    rows = [[(one.x, one.y, one.vx, one.vy) for one in truth.people] for truth in truths]
    if len(set(map(len, rows))) > 1:
        raise RunDataError("the number of people changes between steps")
    return np.array(rows, np.float64).reshape(len(rows), len(rows[0]) if rows else 0, 4)


class RunModel:
    """Accumulated messages of one run: `extend` adds them, `advance` or `take_reports` removes finished data.

    With ground truth a row needs the Truth of its step and all messages of that step; the caller decides when
    it is complete. Without ground truth each report of a robot is a row.
    """

    def __init__(self, description: RunDescription, scheduled: Sequence[RecordedOrder] = ()) -> None:
        """`scheduled`: orders of the scenario."""
        self.description = description
        self._index = {robot: number for number, robot in enumerate(description.robots)}
        self._reports = ItemReports(description)
        self._items_left = np.array(
            [self._reports.left_count(robot) for robot in description.robots], np.int64
        )
        self._floor = FloorHistory(description.step_us)
        self._frames: list[FrameOutcomes] = []
        self.truths: list[Truth] = []
        """Steps with ground truth that were not returned yet."""
        self._drives: list[tuple[str, Drive]] = []
        self._rows: dict[str, list[tuple[float, ...]]] = {}
        """Rows without ground truth, by robot: s, estimated pose, commanded velocity."""
        self._heard: list[tuple[int, float, int, int, float]] = []
        """Step and a row of `RunData.heard`; sender -1 is unknown."""
        self._task_changes: list[tuple[float, TaskChanged]] = []
        """With the start of their steps, s."""
        self._orders = [one for one in scheduled if order_fault(one.order, OrderLimits()) is None]
        """Valid orders that were not returned yet."""
        self._boundary = 0
        """Step at which the world executes the next order from outside."""
        self._states: dict[str, str] = {}
        self._changes: dict[str, list[tuple[float, str]]] = {}
        self._notes: list[str] = []
        self.since = 0.0
        """Everything before this instant has been returned, s."""
        self.step = -1
        """Last step that was returned."""

    def extend(self, key: str, message: Message, second: float | None = None) -> None:
        """Add one message; `second`: start of its step, if the step's number does not determine it.

        Raises RunDataError if the set of robots changes.
        """
        robot = robot_of(key)
        match message:
            case Truth():
                self._add_truth(message)
            case Drive() if robot in self._index:
                if second is None:
                    self._drives.append((robot, message))
                else:
                    self._add_report(robot, message, second)
            case RadioEvents() if robot in self._index:
                self._add_receptions(robot, message)
            case FloorChanged():
                self._floor.extend(message)
            case FrameOutcomes():
                self._frames.append(message)
            case TaskChanged():
                start = in_seconds(message.step * self.description.step_us)
                self._task_changes.append((start if second is None else second, message))
            case RadioAdvanced():
                self._boundary = message.step + 1
            case Control():
                valid = (order for order in message.orders if order_fault(order, OrderLimits()) is None)
                self._orders += [RecordedOrder(self._boundary, order) for order in valid]

    def set_state(self, robot: str, second: float, state: str) -> None:
        """Record a change of a robot's state: a value of `Trajectory.states`."""
        if self._states.get(robot) != state:
            self._states[robot] = state
            self._changes.setdefault(robot, []).append((second, state))

    def add_note(self, sentence: str) -> None:
        """Add a sentence about missing or unknown data."""
        self._notes.append(sentence)

    def advance(
        self, until: int, *, last: bool = False, processes: Sequence[RecordedProcess] = ()
    ) -> RunData:
        """Remove and return the steps up to `until`; `last`: nothing will follow."""
        truths = [one for one in self.truths if one.step <= until]
        self.truths = self.truths[len(truths) :]
        seconds = np.array([in_seconds(one.instant) for one in truths], np.float64)
        if truths:
            self.step = truths[-1].step
        end = float(seconds[-1]) if truths else self.since
        end += in_seconds(self.description.step_us) if last else 0.0
        columns = self._fill_columns(truths, last=last)
        robots = self.description.robots
        for row, second in enumerate(seconds.tolist()):
            for number, robot in enumerate(robots):
                powered, stepping = columns["powered"][row, number], columns["stepping"][row, number]
                self.set_state(robot, second, "off" if not powered else "" if stepping else "frozen")
        true, estimated, commanded = columns["true"], columns["estimated"], columns["commanded"]
        jams = tuple((in_seconds(one.instant), jam) for one in truths for jam in one.jams)
        orders = self._take_orders()
        records_floor = self._floor.is_recorded or not any(
            isinstance(one.order, FLOOR_ORDERS) for one in orders
        )
        if not records_floor:
            self.add_note(NO_CHANGES)
        return self._run_data(
            end,
            seconds,
            columns,
            {
                robot: Trajectory(
                    seconds, true[:, i], estimated[:, i], commanded[:, i], tuple(self._changes.pop(robot, ()))
                )
                for i, robot in enumerate(robots)
            },
            people=_people(truths),
            heard=self._take_heard(None if last else self.step),
            jams=jams,
            orders=orders,
            floor=tuple(self._floor.advance(self.step, jams, end)),
            records_floor=records_floor,
            copies=self._take_copies(last=last),
            processes=tuple(processes),
        )

    def _take_copies(self, *, last: bool) -> FrameCopies:
        """Remove and return the copies of frames up to the current step."""
        now = [one for one in self._frames if last or one.step <= self.step]
        self._frames = self._frames[len(now) :]
        transceivers = [self._index.get(robot, -1) for robot in self.description.addresses.values()]
        return frame_copies(now, transceivers)

    def take_reports(self, end: float, processes: Sequence[RecordedProcess] = ()) -> RunData:
        """Remove and return the robots' reports up to `end`, s, of a run without ground truth."""
        trajectories = {}
        for robot in self.description.robots:
            table = np.array(self._rows.pop(robot, []), np.float64).reshape(-1, 7)
            poses, states = table[:, 1:4], tuple(self._changes.pop(robot, ()))
            trajectories[robot] = Trajectory(table[:, 0], poses, poses, table[:, 4:], states)
        columns = step_columns(0, len(trajectories))
        return self._run_data(
            end,
            np.zeros(0),
            columns,
            trajectories,
            heard=self._take_heard(None),
            processes=tuple(processes),
        )

    def _run_data(
        self,
        end: float,
        seconds: Any,
        columns: dict[str, Any],
        robots: Mapping[str, Trajectory],
        **fields: Any,
    ) -> RunData:
        reports, (marks, events) = self._reports, self._take_task_changes(end)
        data = RunData(
            description=self.description,
            since=self.since,
            end=end,
            seconds=seconds,
            trajectories=robots,
            marks=marks,
            task_events=events,
            taken_over=tuple(reports.taken_over),
            given_up=tuple(reports.given_up),
            routes=tuple(reports.routes),
            notes=tuple(self._notes),
            **columns,
            **fields,
        )
        reports.clear()
        self._notes = []
        self.since = end
        return data

    def _add_truth(self, truth: Truth) -> None:
        if truth.halt or not truth.robots:
            return
        if tuple(robot.id for robot in truth.robots) != self.description.robots:
            raise RunDataError("the set of robots changes between steps")
        self.truths.append(truth)

    def _add_report(self, robot: str, drive: Drive, second: float) -> None:
        self._reports.extend(robot, drive, second)
        row = (second, *(drive.pose or (np.nan,) * 3), drive.vx, drive.vy, drive.omega)
        self._rows.setdefault(robot, []).append(row)

    def _add_receptions(self, robot: str, received: RadioEvents) -> None:
        addresses, receiver = self.description.addresses, self._index[robot]
        for event in received.events:
            if isinstance(event, FrameReceived):
                sender = self._index.get(addresses.get(event.sender, ""), -1)
                row = (received.step, in_seconds(event.instant), sender, receiver, event.rssi_dbm)
                self._heard.append(row)

    def _take_task_changes(
        self, end: float
    ) -> tuple[tuple[tuple[float, ItemMark], ...], tuple[TaskEvent, ...]]:
        """Remove and return the marks with their times, and the events, up to `end`, s."""
        now = [one for one in self._task_changes if one[0] <= end + _ROUNDING]
        self._task_changes = [one for one in self._task_changes if one[0] > end + _ROUNDING]
        now.sort(key=itemgetter(0))
        events = [event for _, changed in now for event in changed.events if event.robot in self._index]
        return (
            tuple((second, mark) for second, changed in now for mark in changed.marks),
            tuple(sorted(events, key=attrgetter("instant"))),
        )

    def _take_heard(self, until: int | None) -> Any:
        """Remove and return the frames received up to a step; None: all."""
        now = [one for one in self._heard if until is None or one[0] <= until]
        self._heard = [] if until is None else [one for one in self._heard if one[0] > until]
        return np.array(sorted(one[1:] for one in now if one[2] >= 0), np.float64).reshape(-1, 4)

    def _take_orders(self) -> tuple[RecordedOrder, ...]:
        """Remove and return the orders up to the current step; those of the scenario come first."""
        now = sorted((one for one in self._orders if one.step <= self.step), key=attrgetter("step"))
        self._orders = [one for one in self._orders if one.step > self.step]
        return tuple(now)

    def _fill_columns(self, truths: Sequence[Truth], *, last: bool) -> dict[str, Any]:
        columns = step_columns(len(truths), len(self._index))
        rows = {one.step: row for row, one in enumerate(truths)}  # a base on board may skip steps
        until = truths[-1].step if truths else -1
        for row, truth in enumerate(truths):
            columns["true"][row] = [(one.x, one.y, one.heading) for one in truth.robots]
            columns["powered"][row] = [one.powered for one in truth.robots]
            columns["stepping"][row] = [one.stepping for one in truth.robots]
            if truth.charges:
                columns["charge"][row] = truth.charges
        columns["items_left"][:] = self._items_left
        for robot, drive in self._drives:
            if drive.step <= until:
                self._add_answer(columns, self._index[robot], robot, drive, rows.get(drive.step, -1))
        self._drives = [(robot, drive) for robot, drive in self._drives if drive.step > until]
        for step, _, _, receiver, _ in self._heard:
            if (last or step <= self.step) and step in rows:
                columns["frames_heard"][rows[step], receiver] += 1
        return columns

    def _add_answer(self, columns: dict[str, Any], index: int, robot: str, drive: Drive, row: int) -> None:
        """Add a robot's answer to the senses of a step."""
        self._reports.extend(robot, drive, in_seconds(drive.step * self.description.step_us))
        if drive.route is not None:
            self._items_left[index] = self._reports.left_count(robot)
            columns["items_left"][max(row, 0) :, index] = self._items_left[index]
        if row >= 0:
            columns["estimated"][row, index] = (np.nan,) * 3 if drive.pose is None else drive.pose
            columns["commanded"][row, index] = (drive.vx, drive.vy, drive.omega)
            columns["frames_sent"][row, index] = drive.transmits
