"""Random situations on the corridor map with one planted cause or none, and strategies that cause some."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from numpy.random import Generator

from acrc_testbed.explanation.cause_classification import CARRIED, NO_CONTACT
from acrc_testbed.explanation.time_spent import Cause
from actors.installation.repository import SHIPPED
from actors.instant import Instant, seconds
from actors.randomness import generator
from actors.robot.behaviour import Behaviour, Start
from actors.robot.behaviour.ports import Decision, GoalOrder, View
from cleaning.place import points
from cleaning.strategies import none
from deploy.scenario.scenario_file import parse
from deploy.scenario.tables import Scenario, toml_document

NECKS: Final = (12.44, 17.25)
"""x of the middle of the two passages between office and corridor, m; 0.88 m wide for y from 8.2 to 10.4."""
_EVERYWHERE: Final = ((12.5, 4.5), (17.3, 4.5), (3.5, 12.4), (9.0, 12.4), (21.0, 12.4), (27.0, 12.4))
"""Points of six rooms or parts of the corridor, too far apart for robots to meet, m."""
_HALLS: Final = ((9.0, 12.4), (19.0, 12.4))
"""The west ends of two wide stretches of corridor, m."""
_Spot = tuple[float, float]


class _Sleeper:
    """The strategy `none` until an instant; then one last decision, and none after it."""

    def __init__(self, awake: Behaviour, at: Instant, last: dict[str, Any]) -> None:
        self._awake, self._at, self._last = awake, at, last
        self._asleep = False

    def advance(self, view: View, until: Instant) -> Decision:
        if self._asleep:
            return Decision()
        decided = self._awake.advance(view, until)
        self._asleep = view.instant >= self._at
        return replace(decided, **self._last) if self._asleep else decided


class _Ditherer:
    """Alternates between two goals before it reaches either."""

    def __init__(self, start: Start) -> None:
        self._places, self._every = points(start.items), _lasting(start, "every_s")
        self._last = -1

    def advance(self, view: View, until: Instant) -> Decision:
        number = view.instant // self._every
        if number == self._last:
            return Decision()
        self._last = number
        return Decision(self._places[number % 2])


def sleeping(start: Start) -> Behaviour:
    """Return a behaviour that stops; settings: robot `who`, instant `asleep_s`, `paused` to keep its goal."""
    awake = none.behaviour(replace(start, settings={}))
    if start.robot != start.settings["who"]:
        return awake
    last: dict[str, Any] = {"paused": True} if start.settings["paused"] else {"goal": GoalOrder.CANCEL}
    return _Sleeper(awake, Instant(_lasting(start, "asleep_s")), last)


def dithering(start: Start) -> Behaviour:
    """Return a behaviour that changes goals; setting `every_s`: period of the changes."""
    return _Ditherer(start)


def _lasting(start: Start, name: str) -> int:
    value = start.settings[name]
    assert isinstance(value, float)
    return seconds(value)


@dataclass(frozen=True)
class Robot:
    """Start, m and rad, and places of a robot, m."""

    start: tuple[float, float, float]
    places: Sequence[_Spot]


@dataclass(frozen=True)
class Situation:
    """A scenario with a planted cause."""

    kind: str
    seed: int
    robots: Sequence[Robot]
    duration: float
    strategy: str = "none"
    events: Sequence[Mapping[str, object]] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    """Settings of the strategy."""
    expected: Mapping[str, Cause] = field(default_factory=dict)
    """By robot, the cause of most of the time in which it could not continue."""
    found: str = ""
    """Name of the expected finding about r1."""

    def scenario(self, navigation: Mapping[str, object] | None = None) -> Scenario:
        """Return the scenario; `navigation` is added to its table of that name."""
        robots = [
            {"id": f"r{number}", "start": _rounded(robot.start), "places": [*map(_rounded, robot.places)]}
            for number, robot in enumerate(self.robots, start=1)
        ]
        file = SHIPPED / "maps" / "corridor.yaml"
        content: dict[str, Any] = {
            "map": str(file),
            "run": {"duration": self.duration, "seed": self.seed, "strategy": self.strategy},
            "strategy": dict(self.settings),
            "localisation": {"preset": "chapter"},
            # this planner, with the original's numbers: robots stand only if they lack room
            "navigation": {"preset": "chapter", "reset_distance": 3.0, **(navigation or {})},
            "planner": {"method": "grid", "factor": 3.0},
            "local_map": {"body": "disc", "allowance": 0.0, "padding": 0.045, "inf_is_valid": True},
            "dwa": {"rules": "disc", "granularity": 0.05},
            "robots": {"count": len(robots)},
            "robot": robots,
            "event": list(self.events),
        }
        return parse(toml_document(content), file)


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 3) for value in values]


def _stuck(
    kind: str, seed: int, robots: Sequence[Robot], lasts: float, cause: Cause, **more: Any
) -> Situation:
    """Return a situation in which `cause` delays the first `count` robots, or all."""
    count = more.pop("count", len(robots))
    return Situation(
        kind, seed, robots, lasts, expected={f"r{n}": cause for n in range(1, count + 1)}, **more
    )


def dead_robot(seed: int) -> Situation:
    """Switch a robot off in a passage that one to three others need."""
    queue, stander = _queue(generator(seed, "causes", "dead"))
    events, count = [{"at": 0.1, "kill": f"r{len(queue) + 1}"}], len(queue)
    robots = (*queue, stander)
    return _stuck("dead robot, queue", seed, robots, 25.0, Cause.BY_DEAD, events=events, count=count)


def done(seed: int) -> Situation:
    queue, stander = _queue(generator(seed, "causes", "done"))
    robots = (*queue, Robot(stander.start, [stander.start[:2]]))
    return _stuck("done robot, queue", seed, robots, 25.0, Cause.DONE_IN_WAY, count=len(queue))


def asleep(seed: int, kind: str = "sleeping", cause: Cause = Cause.STRATEGY_IDLE) -> Situation:
    """Let the strategy of the robot in the passage give no goal although places are left."""
    draw = generator(seed, "causes", "asleep")
    queue, stander = _queue(draw)
    at, paused = round(draw.uniform(0.0, 0.5), 1), cause is Cause.ON_PURPOSE
    settings = {"who": f"r{len(queue) + 1}", "asleep_s": at, "paused": paused}
    strategy, name = f"{__name__}:sleeping", f"{kind} strategy, queue"
    return _stuck(name, seed, (*queue, stander), 25.0, cause, strategy=strategy, settings=settings)


def pauses(seed: int) -> Situation:
    return asleep(seed, "pausing", Cause.ON_PURPOSE)


def head_on(seed: int) -> Situation:
    """Two robots stand head-on in a passage, too close to turn; up to two wait behind one."""
    draw = generator(seed, "causes", "head on")
    x, y, apart = _neck(draw), draw.uniform(8.9, 9.6), draw.uniform(0.36, 0.39)
    south = Robot((x, y, math.pi / 2), [(x, 12.3)])
    north = Robot((x, y + apart, -math.pi / 2), [(x, 4.0)])
    robots = (south, north, *_line(draw, x, y - 0.9, int(draw.integers(3))))
    return _stuck("deadlock in a passage", seed, robots, 15.0, Cause.DEADLOCK)


def head_on_floor(seed: int) -> Situation:
    draw = generator(seed, "causes", "head on floor")
    x, y, apart = draw.uniform(8.0, 11.0), draw.uniform(12.0, 13.0), draw.uniform(0.36, 0.38)
    west = Robot((x, y, 0.0), [(x + 8.0, 12.4)])
    east = Robot((x + apart, y, math.pi), [(max(x - 3.0, 6.8), 12.4)])
    return _stuck("deadlock in a corridor", seed, (west, east), 15.0, Cause.DEADLOCK)


def closed_door(seed: int) -> Situation:
    draw = generator(seed, "causes", "closed")
    x = _neck(draw)
    queue = _line(draw, x, draw.uniform(6.0, 7.0), 1 + int(draw.integers(3)))
    return _stuck(
        "closed door", seed, queue, 25.0, Cause.CLOSED_DOOR, events=[{"at": 0.5, "close": (x, 9.48)}]
    )


def thing_on_place(seed: int) -> Situation:
    draw = generator(seed, "causes", "thing")
    here, there = (_HALLS[k] for k in draw.permutation(2))
    x, y = _near(draw, here)
    place = (here[0] + math.copysign(3.0, there[0] - here[0]) * draw.uniform(0.8, 1.2), y)
    event = {"at": 0.5, "obstacle": _rounded(place), "radius": round(draw.uniform(0.4, 0.6), 2)}
    robot = Robot((x, y, draw.uniform(-3, 3)), [place])
    return _stuck("thing on the place", seed, (robot,), 30.0, Cause.UNREACHABLE, events=[event])


def unreachable(seed: int) -> Situation:
    draw = generator(seed, "causes", "unreachable")
    x = _neck(draw)
    queue = _line(draw, x, draw.uniform(6.0, 7.0), 1 + int(draw.integers(3)))
    event = {"at": 0.5, "obstacle": _rounded((x, draw.uniform(9.0, 9.8))), "radius": 0.4}
    return _stuck("unreachable place", seed, queue, 30.0, Cause.UNREACHABLE, events=[event])


def dithers(seed: int) -> Situation:
    """One or two robots turn round before they reach either of their places."""
    draw = generator(seed, "causes", "dithers")
    robots = []
    for x, y in (_near(draw, _HALLS[k]) for k in draw.permutation(2)[: 1 + int(draw.integers(2))]):
        robots.append(Robot((x, y, draw.uniform(-3, 3)), [(x + 4.5, y), (x - 2.2, y)]))
    more = {"strategy": f"{__name__}:dithering", "settings": {"every_s": round(draw.uniform(3.0, 7.0), 1)}}
    return _stuck("livelock", seed, robots, 60.0, Cause.LIVELOCK, **more)


def carried(seed: int) -> Situation:
    draw = generator(seed, "causes", "carried")
    here, there = (_EVERYWHERE[k] for k in draw.permutation(len(_EVERYWHERE))[:2])
    x, y = _near(draw, there)
    at = round(draw.uniform(3.0, 7.0), 1)
    away = [{"at": at, "move": "r1", "to": _rounded((x, y, draw.uniform(-3, 3)))}]
    return Situation("carried", seed, (_roaming(draw, here, 12),), 20.0, events=away, found=CARRIED)


def jammed(seed: int) -> Situation:
    """Place a jammer beside the standing r1; r2, out of its reach, publishes; r3 is far away."""
    draw = generator(seed, "causes", "jammed")
    here, there = (_HALLS[k] for k in draw.permutation(2))
    spots = _near(draw, here), _near(draw, (here[0] + 2.2, here[1]))
    standing = [Robot((*spot, draw.uniform(-3, 3)), [spot]) for spot in spots]
    begin, radius, lasts = draw.uniform(1.0, 10.0), draw.uniform(0.6, 1.2), draw.uniform(8.0, 15.0)
    jam = {"at": round(begin, 1), "jam": here, "radius": round(radius, 2), "duration": round(lasts, 1)}
    office = (12.5, 4.5) if there[0] < 14.0 else (17.3, 4.5)
    robots = (*standing, Robot((*_near(draw, there), draw.uniform(-3, 3)), [office]))
    return Situation("one robot jammed", seed, robots, 30.0, "chapter", [jam], found=NO_CONTACT)


def all_jammed(seed: int) -> Situation:
    draw = generator(seed, "causes", "all jammed")
    here = _HALLS[int(draw.integers(2))]
    count = 2 + int(draw.integers(2))
    spots = [_near(draw, (here[0] + 2.2 * number - 1.0, here[1])) for number in range(count)]
    robots = [_roaming(draw, spot, 20) for spot in spots]
    begin, lasts = draw.uniform(0.0, 3.0), draw.uniform(8.0, 15.0)
    jam = {"at": round(begin, 1), "jam": here, "radius": 15.0, "duration": round(lasts, 1)}
    return Situation("all robots jammed", seed, robots, 30.0, "chapter", [jam], found=NO_CONTACT)


def quiet(seed: int) -> Situation:
    """One to four robots, each in another part of the floor, with or without adaptation."""
    draw = generator(seed, "causes", "quiet")
    rooms = draw.permutation(len(_EVERYWHERE))[: int(draw.integers(1, 5))]
    robots = tuple(_roaming(draw, _EVERYWHERE[k], 7) for k in rooms)
    return Situation("quiet", seed, robots, 30.0, "chapter" if draw.integers(2) else "none")


Plant = Callable[[int], Situation]
PLANTED: Final[Sequence[Plant]] = (
    dead_robot, done, asleep, pauses, head_on, head_on_floor, closed_door, thing_on_place, unreachable,
    dithers, carried, jammed, all_jammed,
)  # fmt: skip


def _neck(draw: Generator) -> float:
    return NECKS[int(draw.integers(2))]


def _queue(draw: Generator) -> tuple[Sequence[Robot], Robot]:
    """One to three robots before a passage, and one in its middle, with a place elsewhere."""
    x = _neck(draw)
    stander = Robot((x, draw.uniform(8.6, 10.2), draw.uniform(-3, 3)), [(27.0, 12.4)])
    y = stander.start[1] - draw.uniform(1.0, 2.0)
    return _line(draw, x, y, 1 + int(draw.integers(3))), stander


def _line(draw: Generator, x: float, y: float, count: int) -> Sequence[Robot]:
    """Robots in a line from y southwards before a passage; all have places in the corridor behind it."""
    starts = [y - number * draw.uniform(0.7, 0.9) for number in range(count)]
    return [
        Robot((x + draw.uniform(-0.1, 0.1), start, math.pi / 2), [(x + draw.uniform(-0.5, 0.5), 12.4)])
        for start in starts
    ]


def _near(draw: Generator, spot: _Spot) -> _Spot:
    return spot[0] + draw.uniform(-0.3, 0.3), spot[1] + draw.uniform(-0.3, 0.3)


def _roaming(draw: Generator, spot: _Spot, count: int) -> Robot:
    x, y = _near(draw, spot)
    places = [(x + (-0.7 if number % 2 else 0.7), y) for number in range(count)]
    return Robot((x, y, draw.uniform(-3, 3)), places)
