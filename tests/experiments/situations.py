"""Random situations on the corridor map: one planted cause each, or none."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from numpy.random import Generator

from actors.installation.repository import SHIPPED
from actors.randomness import generator
from deploy.scenario.scenario_file import parse
from deploy.scenario.tables import Scenario, document
from observation.accounting.classify import CARRIED, NO_CONTACT
from observation.accounting.time_spent import Cause
from tests.experiments.planted_strategies import DITHERING, SLEEPING

_MAP: Final = SHIPPED / "maps" / "corridor.yaml"
NECKS: Final = (12.44, 17.25)
"""x of the middle of the two passages between office and corridor, m; 0.88 m wide for y from 8.2 to 10.4."""
_EVERYWHERE: Final = ((12.5, 4.5), (17.3, 4.5), (3.5, 12.4), (9.0, 12.4), (21.0, 12.4), (27.0, 12.4))
"""Points of six rooms or parts of the corridor, too far apart for robots to meet, m."""
_HALLS: Final = ((9.0, 12.4), (19.0, 12.4))
"""The west ends of two wide stretches of corridor, m."""
_Spot = tuple[float, float]


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
    """As in a scenario."""
    step_us: int = 100_000
    settings: Mapping[str, object] = field(default_factory=dict)
    """Of the strategy."""
    expected: Mapping[str, Cause] = field(default_factory=dict)
    """By robot, the cause of most of the time in which it could not continue."""
    found: str = ""
    """Name of the expected finding about r1."""

    def scenario(self, navigation: Mapping[str, object] | None = None) -> Scenario:
        """The scenario; `navigation` is added to its table of that name."""
        robots = [
            {"id": f"r{number}", "start": _rounded(robot.start), "places": [*map(_rounded, robot.places)]}
            for number, robot in enumerate(self.robots, start=1)
        ]
        content: dict[str, Any] = {
            "map": str(_MAP),
            "run": {
                "step_ms": self.step_us // 1000,
                "duration": self.duration,
                "seed": self.seed,
                "strategy": self.strategy,
            },
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
        return parse(document(content), _MAP)


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 3) for value in values]


def dead_robot(seed: int) -> Situation:
    """A robot is switched off in a passage that one to three others need."""
    draw = generator(seed, "causes", "dead")
    queue, stander = _queue(draw)
    dead = len(queue) + 1
    event = {"at": 0.1, "kill": f"r{dead}"}
    expected = dict.fromkeys(_names(queue), Cause.BY_DEAD)
    return Situation("dead robot, queue", seed, (*queue, stander), 25.0, events=[event], expected=expected)


def done(seed: int) -> Situation:
    """The same with a robot that has done all its places."""
    draw = generator(seed, "causes", "done")
    queue, stander = _queue(draw)
    finished = Robot(stander.start, [stander.start[:2]])
    expected = dict.fromkeys(_names(queue), Cause.DONE_IN_WAY)
    return Situation("done robot, queue", seed, (*queue, finished), 25.0, expected=expected)


def asleep(seed: int) -> Situation:
    """The same with a robot whose strategy gives no goal although places are left."""
    return _asleep(seed, "sleeping", Cause.STRATEGY_IDLE)


def pauses(seed: int) -> Situation:
    """The same with a robot whose strategy pauses navigation and keeps its goal."""
    return _asleep(seed, "pausing", Cause.ON_PURPOSE)


def _asleep(seed: int, kind: str, cause: Cause) -> Situation:
    draw = generator(seed, "causes", "asleep")
    queue, stander = _queue(draw)
    sleeper = f"r{len(queue) + 1}"
    at, paused = round(draw.uniform(0.0, 0.5), 1), cause is Cause.ON_PURPOSE
    settings = {"who": sleeper, "asleep_s": at, "paused": paused}
    expected = dict.fromkeys([*_names(queue), sleeper], cause)
    robots = (*queue, stander)
    name = f"{kind} strategy, queue"
    return Situation(name, seed, robots, 25.0, SLEEPING, settings=settings, expected=expected)


def head_on(seed: int) -> Situation:
    """Two robots stand head-on in a passage, too close to turn; up to two wait behind one."""
    draw = generator(seed, "causes", "head on")
    x, y, apart = _neck(draw), draw.uniform(8.9, 9.6), draw.uniform(0.36, 0.39)
    south = Robot((x, y, math.pi / 2), [(x, 12.3)])
    north = Robot((x, y + apart, -math.pi / 2), [(x, 4.0)])
    behind = _line(draw, x, y - 0.9, int(draw.integers(3)))
    robots = (south, north, *behind)
    expected = dict.fromkeys(_names(robots), Cause.DEADLOCK)
    return Situation("deadlock in a passage", seed, robots, 15.0, expected=expected)


def head_on_floor(seed: int) -> Situation:
    """Two robots stand head-on in the wide corridor, as close."""
    draw = generator(seed, "causes", "head on floor")
    x, y, apart = draw.uniform(8.0, 11.0), draw.uniform(12.0, 13.0), draw.uniform(0.36, 0.38)
    west = Robot((x, y, 0.0), [(x + 8.0, 12.4)])
    east = Robot((x + apart, y, math.pi), [(max(x - 3.0, 6.8), 12.4)])
    expected = dict.fromkeys(("r1", "r2"), Cause.DEADLOCK)
    return Situation("deadlock in a corridor", seed, (west, east), 15.0, expected=expected)


def closed_door(seed: int) -> Situation:
    """The only door is closed before one to three robots that need it."""
    draw = generator(seed, "causes", "closed")
    x = _neck(draw)
    queue = _line(draw, x, draw.uniform(6.0, 7.0), 1 + int(draw.integers(3)))
    event = {"at": 0.5, "close": (x, 9.48)}
    expected = dict.fromkeys(_names(queue), Cause.CLOSED_DOOR)
    return Situation("closed door", seed, queue, 25.0, events=[event], expected=expected)


def thing_on_place(seed: int) -> Situation:
    """An obstacle is put on the place of r1."""
    draw = generator(seed, "causes", "thing")
    here, there = (_HALLS[k] for k in draw.permutation(2))
    x, y = _near(draw, here)
    place = (here[0] + math.copysign(3.0, there[0] - here[0]) * draw.uniform(0.8, 1.2), y)
    event = {"at": 0.5, "obstacle": _rounded(place), "radius": round(draw.uniform(0.4, 0.6), 2)}
    robot = Robot((x, y, draw.uniform(-3, 3)), [place])
    return Situation(
        "thing on the place", seed, (robot,), 30.0, events=[event], expected={"r1": Cause.UNREACHABLE}
    )


def unreachable(seed: int) -> Situation:
    """An obstacle fills the passage to r1's place, with up to two others behind r1."""
    draw = generator(seed, "causes", "unreachable")
    x = _neck(draw)
    queue = _line(draw, x, draw.uniform(6.0, 7.0), 1 + int(draw.integers(3)))
    event = {"at": 0.5, "obstacle": _rounded((x, draw.uniform(9.0, 9.8))), "radius": 0.4}
    expected = dict.fromkeys(_names(queue), Cause.UNREACHABLE)
    return Situation("unreachable place", seed, queue, 30.0, events=[event], expected=expected)


def dithers(seed: int) -> Situation:
    """One or two robots turn round before they reach either of their places."""
    draw = generator(seed, "causes", "dithers")
    rooms = draw.permutation(2)[: 1 + int(draw.integers(2))]
    robots = []
    for x, y in (_near(draw, _HALLS[k]) for k in rooms):
        robots.append(Robot((x, y, draw.uniform(-3, 3)), [(x + 4.5, y), (x - 2.2, y)]))
    settings = {"every_s": round(draw.uniform(3.0, 7.0), 1)}
    expected = dict.fromkeys(_names(robots), Cause.LIVELOCK)
    return Situation("livelock", seed, robots, 60.0, DITHERING, settings=settings, expected=expected)


def carried(seed: int) -> Situation:
    """r1 is carried elsewhere."""
    draw = generator(seed, "causes", "carried")
    here, there = (_EVERYWHERE[k] for k in draw.permutation(len(_EVERYWHERE))[:2])
    x, y = _near(draw, there)
    at = round(draw.uniform(3.0, 7.0), 1)
    away = [{"at": at, "move": "r1", "to": _rounded((x, y, draw.uniform(-3, 3)))}]
    return Situation("carried", seed, (_roaming(draw, here, 12),), 20.0, events=away, found=CARRIED)


def jammed(seed: int) -> Situation:
    """A jammer beside r1, which stands; r2, out of its reach, publishes; r3 is far away."""
    draw = generator(seed, "causes", "jammed")
    here, there = (_HALLS[k] for k in draw.permutation(2))
    spots = _near(draw, here), _near(draw, (here[0] + 2.2, here[1]))
    standing = [Robot((*spot, draw.uniform(-3, 3)), [spot]) for spot in spots]
    begin, radius = draw.uniform(1.0, 10.0), draw.uniform(0.6, 1.2)
    jam = {
        "at": round(begin, 1),
        "jam": here,
        "radius": round(radius, 2),
        "duration": round(draw.uniform(8.0, 15.0), 1),
    }
    office = (12.5, 4.5) if there[0] < 14.0 else (17.3, 4.5)
    busy = Robot((*_near(draw, there), draw.uniform(-3, 3)), [office])
    robots = (*standing, busy)
    return Situation("one robot jammed", seed, robots, 30.0, "chapter", [jam], found=NO_CONTACT)


def all_jammed(seed: int) -> Situation:
    """A jammer reaches all robots, so that none sends."""
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
    strategy = "chapter" if draw.integers(2) else "none"
    return Situation("quiet", seed, robots, 30.0, strategy)


Plant = Callable[[int], Situation]
PLANTED: Final[Sequence[Plant]] = (
    dead_robot, done, asleep, pauses, head_on, head_on_floor, closed_door, thing_on_place, unreachable,
    dithers, carried, jammed, all_jammed,
)  # fmt: skip


def _names(robots: Sequence[Robot]) -> list[str]:
    return [f"r{number}" for number in range(1, len(robots) + 1)]


def _neck(draw: Generator) -> float:
    return NECKS[int(draw.integers(2))]


def _stander(draw: Generator, x: float) -> Robot:
    """A robot in the middle of the passage, with a place elsewhere."""
    return Robot((x, draw.uniform(8.6, 10.2), draw.uniform(-3, 3)), [(27.0, 12.4)])


def _queue(draw: Generator) -> tuple[Sequence[Robot], Robot]:
    """One to three robots before a passage, and one in it."""
    x = _neck(draw)
    stander = _stander(draw, x)
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
    """A robot with places close to its start."""
    x, y = _near(draw, spot)
    places = [(x + (-0.7 if number % 2 else 0.7), y) for number in range(count)]
    return Robot((x, y, draw.uniform(-3, 3)), places)
