"""Situations on the corridor map with one planted cause each, and quiet ones without any, drawn by seed."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from numpy.random import Generator

from actors.installation.repository import SHIPPED
from actors.randomness import generator
from deploy.scenario.scenario_file import parse
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import document

_MAP: Final = SHIPPED / "maps" / "corridor.yaml"
NECKS: Final = (12.44, 17.25)
"""x of the middle of the two passages between office and corridor, m; 0.88 m wide for y from 8.2 to 10.4."""
_EVERYWHERE: Final = ((12.5, 4.5), (17.3, 4.5), (3.5, 12.4), (9.0, 12.4), (21.0, 12.4), (27.0, 12.4))
"""Points of six rooms or parts of the corridor that are so far apart that nobody meets, m."""
_HALLS: Final = ((9.0, 12.4), (19.0, 12.4))
"""The west ends of two wide stretches of corridor, m."""
_Spot = tuple[float, float]


@dataclass(frozen=True)
class Robot:
    """One robot of a situation: where it starts, m and rad, and which places it has, m."""

    start: tuple[float, float, float]
    places: Sequence[_Spot]


@dataclass(frozen=True)
class Situation:
    """A scenario, and what was planted in it."""

    kind: str
    seed: int
    robots: Sequence[Robot]
    duration: float
    strategy: str = "none"
    events: Sequence[Mapping[str, object]] = ()
    """As in a scenario."""
    step_us: int = 100_000

    def scenario(self, navigation: Mapping[str, object] | None = None) -> Scenario:
        """As a scenario, with this in its table `navigation`."""
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
            "localisation": {"preset": "chapter"},
            "navigation": {"preset": "improved", **(navigation or {})},
            "robots": {"count": len(robots)},
            "robot": robots,
            "event": list(self.events),
        }
        return parse(document(content), _MAP)


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 3) for value in values]


def parked(seed: int) -> Situation:
    """r2 is switched off in a door; r1 wants through it."""
    draw = generator(seed, "causes", "parked")
    x = _neck(draw)
    switched_off = [{"at": round(draw.uniform(0.2, 2.0), 1), "kill": "r2"}]
    return Situation(
        "parked in a door", seed, (_through(draw, x), _stander(draw, x)), 40.0, "none", switched_off
    )


def done(seed: int) -> Situation:
    """r2 has done all it had to do, and stands in a door; r1 wants through it."""
    draw = generator(seed, "causes", "done")
    x = _neck(draw)
    stander = _stander(draw, x)
    finished = Robot(stander.start, [stander.start[:2]])
    return Situation("done in a door", seed, (_through(draw, x), finished), 40.0)


def wedged(seed: int) -> Situation:
    """Two robots stand head-on in a passage, so near that neither of them finds a way."""
    draw = generator(seed, "causes", "wedged")
    x, y, apart = _neck(draw), draw.uniform(8.6, 10.0), draw.uniform(0.36, 0.39)
    south = Robot((x, y, math.pi / 2), [(x, 12.3)])
    north = Robot((x, y + apart, -math.pi / 2), [(x, 4.0)])
    return Situation("wedged", seed, (south, north), 30.0)


def carried(seed: int) -> Situation:
    """r1 is put somewhere else."""
    draw = generator(seed, "causes", "carried")
    here, there = (_EVERYWHERE[k] for k in draw.permutation(len(_EVERYWHERE))[:2])
    x, y = _near(draw, there)
    at = round(draw.uniform(3.0, 10.0), 1)
    away = [{"at": at, "move": "r1", "to": _rounded((x, y, draw.uniform(-3, 3)))}]
    return Situation("carried", seed, (_roaming(draw, here, 12),), 20.0, "none", away)


def jammed(seed: int) -> Situation:
    """A jammer beside r1, which stands; r2, out of its reach, publishes what it knows; r3 is far away."""
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
    return Situation("jammed", seed, (*standing, _roaming(draw, there, 12)), 30.0, "chapter", [jam])


def quiet(seed: int) -> Situation:
    """One to four robots, each in a part of the floor of its own, with or without adaptation."""
    draw = generator(seed, "causes", "quiet")
    rooms = draw.permutation(len(_EVERYWHERE))[: int(draw.integers(1, 5))]
    robots = tuple(_roaming(draw, _EVERYWHERE[k], 7) for k in rooms)
    strategy = "chapter" if draw.integers(2) else "none"
    return Situation("quiet", seed, robots, 30.0, strategy)


Plant = Callable[[int], Situation]
PLANTED: Final[Sequence[Plant]] = (parked, done, wedged, carried, jammed)


def _neck(draw: Generator) -> float:
    return NECKS[int(draw.integers(2))]


def _stander(draw: Generator, x: float) -> Robot:
    """In the middle of the passage; it would want to go elsewhere."""
    return Robot((x, draw.uniform(8.6, 10.2), draw.uniform(-3, 3)), [(27.0, 12.4)])


def _through(draw: Generator, x: float) -> Robot:
    """From the office out, or the other way round."""
    office, corridor = (x + draw.uniform(-0.2, 0.2), 5.5), (x + draw.uniform(-0.5, 0.5), 12.4)
    if draw.integers(2):
        return Robot((*office, math.pi / 2), [corridor])
    return Robot((*corridor, -math.pi / 2), [office])


def _near(draw: Generator, spot: _Spot) -> _Spot:
    return spot[0] + draw.uniform(-0.3, 0.3), spot[1] + draw.uniform(-0.3, 0.3)


def _roaming(draw: Generator, spot: _Spot, count: int) -> Robot:
    """Has places near where it starts, to and fro."""
    x, y = _near(draw, spot)
    places = [(x + (-0.7 if number % 2 else 0.7), y) for number in range(count)]
    return Robot((x, y, draw.uniform(-3, 3)), places)
