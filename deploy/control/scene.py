"""State of a run for the map page, as JSON objects."""

import base64
import io
import math
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from acrc_testbed.explanation.episodes import STANDARD, ObservedActivity
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated_runs import run_model
from actors.array_types import Floats
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.messages import (
    Control,
    FloorChanged,
    ItemMark,
    Jam,
    OrderOutcomes,
    Progress,
    TaskChanged,
    Truth,
    UnmappedObstacle,
)
from actors.observer import glyphs
from actors.observer.glyphs import ACTIVITY_GLYPHS, MARKS, Mark, contrast, hexadecimal
from actors.orders import Freeze, Kill, Move, Order, Restart, Speed, Thaw
from actors.radio.radio_model import RadioSetup
from actors.robot_model import load_model
from actors.topic import Message
from actors.world.world_setup import WorldSetup

STATES: Final = ("driving", "standing", "blocked", "idle", "frozen", "off")
"""Externally observed states of a robot; "blocked": it stands near another robot."""
LEGEND: Final = {
    **{name: MARKS[name] for name in ("off", "frozen")},
    "blocked": Mark("blocked", ACTIVITY_GLYPHS["blocked"].colour, "blocked robot, and the robot in its way"),
    "destination": Mark("dashes", None, "to the next item of the robot's route"),
    "trail": Mark("trail", None, "path of the last 20 s"),
    "link": Mark("link", None, "frame received in the last 3 s"),
    **{name: MARKS[name] for name in ("door", "closed door", "wall", "obstacle", "jammer")},
    "person": MARKS["person"]._replace(meaning="person"),
}  # fmt: skip
TRAIL_S: Final = 20.0
TRAIL_STEP_S: Final = 0.5
LINK_S: Final = 3.0
"""Time for which a link is shown after a frame, s; our choice: the chapter's robots send every second."""
MAX_LINKS: Final = 400
"""Maximum number of links shown, newest first."""
MAX_PENDING_ORDERS: Final = 256
"""Maximum number of unanswered orders; older ones are dropped."""


def state_colours(state: str) -> tuple[str, str]:
    """Return the colour of a state, and white or black text colour, by contrast."""
    ground = ACTIVITY_GLYPHS[state].colour
    ink = max(glyphs.WHITE, glyphs.BLACK, key=lambda colour: contrast(colour, ground))
    return hexadecimal(ground), hexadecimal(ink)


def floor_message(setup: WorldSetup, grid: OccupancyGrid) -> dict[str, Any]:
    """Return the constant data of a run; the image is opaque on obstacles, north is up."""
    radii = {one.id: load_model(one.model, one.sensor).footprint.circumradius for one in setup.robots}
    doorways, doors = Doorways(grid, max(radii.values())), []
    for door in doorways.regions.doors:
        try:
            doors.append([(end.x, end.y) for end in doorways.ends_of(doorways.closed_cells(door))])
        except DoorError:  # an order to close it would be refused, too
            continue
    cells, file = grid.cells[::-1], io.BytesIO()
    alpha = np.where(cells == FREE, 0, np.where(cells == UNKNOWN, 40, 255)).astype(np.uint8)
    Image.merge("LA", (Image.new("L", (grid.columns, grid.rows)), Image.fromarray(alpha))).save(file, "PNG")
    robots = {
        robot: {"radius": radius, "colour": hexadecimal(glyphs.robot(index))}
        for index, (robot, radius) in enumerate(radii.items())
    }
    legend = {name: one for name, one in LEGEND.items() if name != "person" or setup.has_people}
    task = setup.task.declaration
    return {
        "kind": "floor", "png": base64.b64encode(file.getvalue()).decode(),
        "west": grid.origin.x, "south": grid.origin.y,
        "width": grid.columns * grid.resolution, "height": grid.rows * grid.resolution,
        "robots": robots, "doors": doors, "legend": _drawn(legend), "person": glyphs.PERSON_RADIUS,
        "states": {state: state_colours(state) for state in STATES},
        "marks": _drawn(glyphs.item_marks(task)),
        "open": [name for name, one in task.marks.items() if one.is_open],
        "item": task.item, "items": task.items, "done": task.done,
        "is_point": _is_point(task.schemas.get("item")),
    }  # fmt: skip


def _drawn(marks: Mapping[str, Mark]) -> dict[str, tuple[str, str, str]]:
    """Return shape, colour, empty for a robot's, and text of marks, by name."""
    return {
        name: (one.shape, hexadecimal(one.colour) if one.colour else "", one.meaning)
        for name, one in marks.items()
    }


def _is_point(schema: object) -> bool:
    """Return True if items of this JSON schema are points [x, y], m."""
    parts = schema.get("prefixItems") if isinstance(schema, dict) else None
    return isinstance(parts, list) and [one.get("type") for one in parts] == ["number"] * 2


class Scene:
    """Current state of a run, including effects of orders during a pause."""

    def __init__(self, setup: WorldSetup, radio: RadioSetup, speed: float) -> None:
        """`speed`: initial simulated s per s, 0: no limit."""
        self._model = run_model(Path(), setup, radio)
        counts = self._model.description.item_counts
        self._floor, self._speed = floor_message(setup, self._model.description.grid), speed
        self._items: dict[ItemKey, ItemMark] = {}
        self._left = self._done = 0
        """Numbers of items, as in Progress."""
        self._next = {robot: ItemKey(robot, 0) if count else None for robot, count in counts.items()}
        """First item of each robot's route."""
        self._poses: dict[str, tuple[float, ...]] = {one.id: one.start for one in setup.robots}
        self._states = dict.fromkeys(counts, "driving")
        self._activities = {
            robot: ObservedActivity(robot, has_items=bool(count) or not setup.task.declaration.lists_items)
            for robot, count in counts.items()
        }
        self._trail: deque[tuple[float, Floats]] = deque(maxlen=int(TRAIL_S / TRAIL_STEP_S) + 1)
        """Times, s, and poses of all robots, (robots, 3)."""
        self._pending: OrderedDict[str, tuple[Order, ...]] = OrderedDict()
        self._obstacles: dict[int, UnmappedObstacle] = {}
        self._jams: list[Jam] = []
        self._people: list[tuple[float, float]] = []
        self._received: dict[tuple[int, int], float] = {}
        self._instant, self._step, self._missed, self._paused_at = 0, -1, 0, -1
        self.changed, self.over = True, False

    def take(self, key: str, message: Message) -> None:
        """Process one message of the run."""
        self.changed = True
        match message:
            case Progress():
                self._paused_at = message.step if message.paused else -1
                self.over = self.over or message.finished
                self._left, self._done = message.left, message.done
            case TaskChanged():
                self._items |= {one.key: one for one in message.marks}
            case FloorChanged():
                self._obstacles |= {one.number: one for one in message.put}
                for number in message.gone:
                    self._obstacles.pop(number, None)
            case Control():
                self._pending[message.ticket] = message.orders
                while len(self._pending) > MAX_PENDING_ORDERS:
                    self._pending.popitem(last=False)
            case OrderOutcomes():
                orders = self._pending.pop(message.ticket, ())
                self._apply(() if message.refusals else orders)
            case Truth(halt=True):
                self.over = True
            case _:
                self._model.extend(key, message)
                if isinstance(message, Truth):
                    self._missed += max(0, message.step - self._step - 1) if self._step >= 0 else 0
                    self._step, self._instant = message.step, message.instant
                    self._jams += message.jams
                    self._people = [(round(one.x, 3), round(one.y, 3)) for one in message.people]
                    self._apply_run(self._model.advance(message.step))

    def _apply_run(self, run: RunData) -> None:
        self._apply(one.order for one in run.orders if isinstance(one.order, Speed))
        self._next |= {route.robot: next(iter(route.items), None) for route in run.routes}
        for second, sender, receiver, _ in run.heard.tolist():
            pair = (int(min(sender, receiver)), int(max(sender, receiver)))
            self._received[pair] = max(second, self._received.get(pair, 0.0))
        for second, poses in zip(run.seconds.tolist(), run.true, strict=True):
            self._poses = dict(zip(run.robots, map(tuple, poses.tolist()), strict=True))
            if not self._trail or second - self._trail[-1][0] >= TRAIL_STEP_S:
                self._trail.append((second, poses.round(3)))
        for robot, track in run.trajectories.items():
            activities = self._activities[robot].extend(track, run.routes)
            for _, state in [*((second, state or "driving") for second, state in track.states), *activities]:
                self._states[robot] = state

    def _apply(self, orders: Iterable[Order]) -> None:
        for order in orders:
            match order:
                case Move(robot, x, y, heading):
                    self._poses[robot] = (x, y, heading)
                case Kill(robot) | Freeze(robot):
                    self._states[robot] = "off" if isinstance(order, Kill) else "frozen"
                case Thaw(robot) | Restart(robot):
                    self._states[robot] = "driving"
                case Speed(factor):
                    self._speed = factor

    def floor(self) -> dict[str, Any]:
        """Return the constant data and the trails so far."""
        trails = {
            robot: [(second, *poses[index, :2].tolist()) for second, poses in self._trail]
            for index, robot in enumerate(self._poses)
        }
        return self._floor | {"trails": trails}

    def state(self) -> dict[str, Any]:
        """Return the current state; lengths in m, times in simulated s."""
        now = in_seconds(self._instant)
        self._jams = [jam for jam in self._jams if jam.until > self._instant]
        self._received = {pair: second for pair, second in self._received.items() if second >= now - LINK_S}
        newest = sorted(self._received, key=lambda pair: (-self._received[pair], pair))[:MAX_LINKS]
        things = [(one.kind, list(one.points), one.radius, 0.0) for one in self._obstacles.values()]
        things += [("jammer", [(j.x, j.y)], j.radius, in_seconds(j.until) - now) for j in self._jams]
        items = [(one.owner, one.x, one.y, one.state, one.by) for one in self._items.values() if one.state]
        return {
            "kind": "state", "t": now, "step": max(self._step, 0), "paused": self._step < self._paused_at,
            "speed": self._speed, "over": self.over, "missed": self._missed, "links": sorted(newest),
            "robots": [self._robot(robot) for robot in self._poses],
            "items": items, "left": self._left, "done": self._done, "things": things, "people": self._people,
        }  # fmt: skip

    def _robot(self, robot: str) -> tuple[Any, ...]:
        """Return id, x, y, heading, state, position of the next item, and the blocking robot."""
        pose, state, key = self._poses[robot], self._states[robot], self._next[robot]
        blocker = ""
        if state == "standing":
            others = [(math.dist(pose[:2], at[:2]), one) for one, at in self._poses.items() if one != robot]
            distance, nearest = min(others, default=(math.inf, ""))
            if distance <= STANDARD.block_distance:
                state, blocker = "blocked", nearest
        item = self._items.get(key) if key is not None and state not in ("frozen", "off") else None
        position = None if item is None else (item.x, item.y)
        return (robot, *(round(one, 3) for one in pose), state, position, blocker)
