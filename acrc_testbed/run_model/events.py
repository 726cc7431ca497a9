"""Events of a run that neither robots' states nor their reports show: what people or the scenario ordered."""

import math
from typing import Final, NamedTuple

from acrc_testbed.run_model.data import RunData
from actors.instant import in_seconds
from actors.orders import CloseDoor, Give, Lose, Move, Obstacle, OpenDoor, Order, StartJam, Wall

_THERE: Final = 0.1
"""A robot that was carried is within this of the ordered point at that step, m."""


class OrderedChange(NamedTuple):
    """A change of the world by an order."""

    second: float
    robot: str
    """The robot that is concerned; empty: none."""
    words: str


def ordered_changes(run: RunData) -> list[OrderedChange]:
    """Return the orders that took effect and that no other mark shows, by step.

    A robot that is to be carried is listed only if it was: the world may have refused.
    """
    found = []
    for step, order in run.orders:
        if words := _words(order):
            robot = order.robot if isinstance(order, Give | Move | Lose) else ""
            if not isinstance(order, Move) or _carried(run, step, order):
                found.append(OrderedChange(in_seconds(step * run.step_us), robot, words))
    return found


def _carried(run: RunData, step: int, order: Move) -> bool:
    if order.robot not in run.robots or not len(run.seconds):
        return False
    row = step - round(run.seconds[0] * 1e6) // run.step_us
    x, y = run.true[min(max(row, 0), len(run.true) - 1), run.robots.index(order.robot), :2].tolist()
    return math.dist((x, y), (order.x, order.y)) < _THERE


def _words(order: Order) -> str:
    """Describe an order; "" for one that other marks show."""
    words = ""
    match order:
        case Obstacle(x, y, radius):
            words = f"a thing of {2 * radius:g} m is put at ({x:.1f}, {y:.1f})"
        case Wall(x, y, to_x, to_y):
            words = f"a wall is put from ({x:.1f}, {y:.1f}) to ({to_x:.1f}, {to_y:.1f})"
        case CloseDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) is to close"
        case OpenDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) opens"
        case StartJam(x, y, radius, duration):
            words = f"a jammer of {radius:g} m at ({x:.1f}, {y:.1f}) for {in_seconds(duration):g} s"
        case Give(_, places):
            words = f"is given {len(places)} more place{'' if len(places) == 1 else 's'}"
        case Move(_, x, y, _):
            words = f"is carried to ({x:.1f}, {y:.1f})"
        case Lose(_, sender):
            words = f"is to lose the next frame of {sender}"
    return words
