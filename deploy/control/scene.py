"""A run as the map page shows it: what does not change, and how things stand now, as JSON objects."""

import base64
import io
import math
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from acrc_testbed.explanation.episodes import STANDARD
from acrc_testbed.run_model.data import RunData, RunDescription
from acrc_testbed.run_model.model import RunModel
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.instant import in_seconds
from actors.messages import Answered, Control, FloorChanged, FloorThing, Jam, Progress, Truth
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, OWN_STATES, Mark, contrast, hexadecimal
from actors.orders import Freeze, Give, Kill, Move, Order, Restart, Speed, Thaw
from actors.robot_model import load_model
from actors.task.task import PlaceKey
from actors.topic import Message
from actors.world.world_setup import WorldSetup

STATES: Final = ("driving", "standing", "blocked", "idle", "frozen", "off")
"""Of a robot seen from outside. "standing": it means to visit places, and stays where it is; "blocked": the
same with another robot near it; "idle": it stays, and means to visit none."""
LEGEND: Final[Mapping[str, Mark]] = {
    **{name: MARKS[name] for name in ("open", "given")},
    "done": MARKS["done"]._replace(shape="dim disc", says="place reported as done"),
    **{name: MARKS[name]._replace(says=says) for name, says in (
        ("given up", "place given up"), ("off", "robot off"), ("frozen", "robot frozen"))},
    "blocked": Mark("blocked", OWN_STATES["blocked"].colour, "robot blocked: it stays, and by whom"),
    "destination": Mark("dashes", None, "the place that a robot says it visits next"),
    "trail": Mark("trail", None, "where a robot was in the last 20 s"),
    "link": Mark("link", None, "one robot heard the other in the last 3 s"),
    **{name: MARKS[name] for name in ("door", "closed door", "wall", "obstacle", "jammer")},
}  # fmt: skip
TRAIL_S: Final = 20.0
TRAIL_STEP_S: Final = 0.5
LINK_S: Final = 3.0
"""How long a link is shown after a frame. Own choice: the chapter's robots send once a second."""
LINKS: Final = 400
"""At most; of more, the newest are shown."""
PENDING: Final = 256
"""Orders without an answer yet; older ones are forgotten."""


def state_colours() -> dict[str, tuple[str, str]]:
    """Return the colour of each state, and white or black for letters on it, whichever is read better."""
    grounds = {state: OWN_STATES[state].colour for state in STATES}
    inks = {state: max(glyphs.WHITE, glyphs.BLACK, key=lambda ink: contrast(ink, ground))
            for state, ground in grounds.items()}  # fmt: skip
    return {state: (hexadecimal(grounds[state]), hexadecimal(inks[state])) for state in STATES}


def floor_message(setup: WorldSetup, grid: OccupancyGrid) -> dict[str, Any]:
    """Return what does not change of a run; the image is opaque where something stands, north is up."""
    radii = {one.id: load_model(one.model, one.sensor).footprint.circumradius for one in setup.robots}
    doorways, doors = Doorways(grid, max(radii.values())), []
    for door in doorways.regions.doors:
        try:
            doors.append([(end.x, end.y) for end in doorways.leaf(doorways.closed(door))])
        except DoorError:  # an order to close it would be refused, too
            continue
    cells, file = grid.cells[::-1], io.BytesIO()
    alpha = np.where(cells == FREE, 0, np.where(cells == UNKNOWN, 40, 255)).astype(np.uint8)
    Image.merge("LA", (Image.new("L", (grid.columns, grid.rows)), Image.fromarray(alpha))).save(file, "PNG")
    colours = [hexadecimal(glyphs.robot(index)) for index in range(len(radii))]
    return {
        "kind": "floor", "png": base64.b64encode(file.getvalue()).decode(),
        "west": grid.origin.x, "south": grid.origin.y,
        "width": grid.columns * grid.resolution, "height": grid.rows * grid.resolution,
        "robots": {
            robot: {"radius": radii[robot], "colour": colour}
            for robot, colour in zip(radii, colours, strict=True)
        },
        "doors": doors, "states": state_colours(),
        "legend": {
            name: (one.shape, hexadecimal(one.colour) if one.colour else "", one.says)
            for name, one in LEGEND.items()
        },
    }  # fmt: skip


class SeenRobot:
    """One robot seen from outside. It stands and is blocked as the accounting has it."""

    def __init__(self, robot: str, start: tuple[float, float, float], route: tuple[PlaceKey, ...]) -> None:
        self.id, self.pose, self.route, self.state = robot, start, route, "driving"
        self.trail: deque[tuple[float, ...]] = deque(maxlen=int(TRAIL_S / TRAIL_STEP_S) + 1)
        self._since, self._there = 0.0, start[:2]

    def see(self, second: float, pose: tuple[float, float, float], state: str) -> None:
        """It is there now."""
        if state != self.state or math.dist(self._there, pose[:2]) > STANDARD.still:
            self._since, self._there = second, pose[:2]
        self.pose, self.state = pose, state
        if not self.trail or second - self.trail[-1][0] >= TRAIL_STEP_S:
            self.trail.append(tuple(round(one, 3) for one in (second, *pose[:2])))

    def stays(self, second: float) -> bool:
        """True if its program runs, and it has not moved lately."""
        return self.state == "driving" and second - self._since >= STANDARD.pause_s


class Scene:
    """Folds the messages of a run. While the run is paused, orders tell what they have changed of robots."""

    def __init__(
        self, setup: WorldSetup, grid: OccupancyGrid, speed: float, addresses: Mapping[int, str]
    ) -> None:
        """`speed`: simulated s per s at the start, 0: no limit; `addresses`: robots by short address."""
        own = {robot.id: robot.places for robot in setup.robots}
        self.floor, self._speed, self._events = floor_message(setup, grid), speed, deque(setup.events)
        self._model = RunModel(RunDescription(
            out=Path(), title="", robots=tuple(own), grid=grid, step_us=setup.step_us, own_places=own,
            addresses=addresses,
        ))  # fmt: skip
        self._places = {PlaceKey(robot, n): at for robot in own for n, at in enumerate(own[robot])}
        self._stands = dict.fromkeys(self._places, "open")
        self._robots = {
            one.id: SeenRobot(one.id, one.start, tuple(key for key in self._places if key.owner == one.id))
            for one in setup.robots
        }
        self._pending: OrderedDict[str, tuple[Order, ...]] = OrderedDict()
        self._things: dict[int, FloorThing] = {}
        self._jams: list[Jam] = []
        self._heard: dict[tuple[int, int], float] = {}
        self._instant, self._step, self._missed, self._paused_at = 0, -1, 0, -1
        self.changed, self.over = True, False

    def take(self, key: str, message: Message) -> None:
        """Fold one message of the run."""
        self.changed = True
        match message:
            case Progress():
                self._paused_at = message.step if message.paused else -1
                self.over = self.over or message.finished
            case FloorChanged():
                self._things |= {one.number: one for one in message.put}
                for number in message.gone:
                    self._things.pop(number, None)
            case Control():
                self._pending[message.ticket] = message.orders
                while len(self._pending) > PENDING:
                    self._pending.popitem(last=False)
            case Answered():
                orders = self._pending.pop(message.ticket, ())
                self._carried_out(() if message.refusals else orders)
            case Truth(halt=True):
                self.over = True
            case _:
                self._model.extend(key, message)
                if isinstance(message, Truth):
                    self._see(message)

    def _see(self, truth: Truth) -> None:
        self._missed += max(0, truth.step - self._step - 1) if self._step >= 0 else 0
        self._step, self._instant = truth.step, truth.instant
        self._fold(self._model.advance(truth.step))
        while self._events and self._events[0].instant <= truth.instant:
            order = self._events.popleft().order
            self._carried_out((order,) if isinstance(order, Give | Speed) else ())

    def _fold(self, run: RunData) -> None:
        self._jams += [jam for _, jam in run.jams]
        for route in run.routes:
            self._robots[route.robot].route = route.places
        for what, events in (("given up", run.given_up), ("done", run.reported)):
            for event in events:
                if self._stands.get(event.place, "done") != "done":
                    self._stands[event.place] = what
        for second, sender, receiver, _ in run.heard.tolist():
            pair = (int(min(sender, receiver)), int(max(sender, receiver)))
            self._heard[pair] = max(second, self._heard.get(pair, 0.0))
        for row, second in enumerate(run.seconds.tolist()):
            for number, robot in enumerate(self._robots.values()):
                idle = "frozen" if run.powered[row, number] else "off"
                x, y, heading = run.true[row, number].tolist()
                robot.see(second, (x, y, heading), "driving" if run.stepping[row, number] else idle)

    def _carried_out(self, orders: Iterable[Order]) -> None:
        for order in orders:
            match order:
                case Move(robot, x, y, heading):
                    self._robots[robot].pose = (x, y, heading)
                case Kill(robot) | Freeze(robot):
                    self._robots[robot].state = "off" if isinstance(order, Kill) else "frozen"
                case Thaw(robot) | Restart(robot):
                    self._robots[robot].state = "driving"
                case Give(robot, places):
                    for place in places:
                        key = PlaceKey(robot, sum(one.owner == robot for one in self._places))
                        self._places[key], self._stands[key] = place, "given"
                case Speed(factor):
                    self._speed = factor

    def past(self) -> dict[str, Any]:
        """Return the trails so far, for a page that was opened late."""
        return {"kind": "past", "trails": {robot.id: tuple(robot.trail) for robot in self._robots.values()}}

    def state(self) -> dict[str, Any]:
        """Return how things stand now; lengths in m, times in simulated s."""
        now = in_seconds(self._instant)
        self._jams = [jam for jam in self._jams if jam.until > self._instant]
        self._heard = {pair: second for pair, second in self._heard.items() if second >= now - LINK_S}
        newest = sorted(self._heard, key=lambda pair: (-self._heard[pair], pair))[:LINKS]
        things = [(one.kind, list(one.points), one.radius, 0.0) for one in self._things.values()]
        left = [in_seconds(jam.until) - now for jam in self._jams]
        things += [("jammer", [(j.x, j.y)], j.radius, s) for j, s in zip(self._jams, left, strict=True)]
        return {
            "kind": "state", "t": now, "step": max(self._step, 0), "paused": self._step < self._paused_at,
            "speed": self._speed, "over": self.over, "missed": self._missed, "links": sorted(newest),
            "robots": [self._shown(robot, now) for robot in self._robots.values()],
            "places": [(key.owner, *at, self._stands[key]) for key, at in self._places.items()],
            "things": things,
        }  # fmt: skip

    def _shown(self, robot: SeenRobot, now: float) -> tuple[Any, ...]:
        """Return id, x, y, heading, state, next place, and the robot by which it is blocked."""
        state, blocker = robot.state, ""
        if robot.stays(now):
            others = (one for one in self._robots.values() if one is not robot)
            near = sorted((math.dist(robot.pose[:2], one.pose[:2]), one.id) for one in others)[:1]
            is_near = bool(near) and near[0][0] <= STANDARD.near
            state = "idle" if not robot.route else "blocked" if is_near else "standing"
            blocker = near[0][1] if state == "blocked" else ""
        heads = self._places.get(robot.route[0]) if robot.route and robot.state == "driving" else None
        return (robot.id, *(round(one, 3) for one in robot.pose), state, heads, blocker)
