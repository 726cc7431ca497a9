"""Behaviours, right and wrong, for tests to load by their entry strings."""

from actors.geometry import Point
from actors.instant import Instant
from actors.messages import Outgoing
from actors.robot.behaviour.goal import GoalOrder
from actors.robot.behaviour.ports import Behaviour, Decision, Start, View

number = 7


class Scripted:
    """Keeps every view, and decides what it was told to."""

    def __init__(self, decision: object = None) -> None:
        self.decision = decision
        self.views: list[tuple[View, Instant]] = []

    def advance(self, view: View, until: Instant) -> Decision:
        self.views.append((view, until))
        if isinstance(self.decision, Exception):
            raise self.decision
        return self.decision or Decision()  # type: ignore[return-value]


def idle(start: Start) -> Behaviour:
    return Scripted()


def chatty(start: Start) -> Behaviour:
    return Scripted(Decision(Point(1.0, 2.0), frames=(Outgoing(0, 0, b"x"),)))


def nothing(start: Start) -> None:
    return None


def fails(start: Start) -> Behaviour:
    raise ZeroDivisionError("of the user's own")


def keeper(start: Start) -> Behaviour:
    return Scripted(Decision(GoalOrder.KEEP))
