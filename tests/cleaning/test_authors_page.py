"""docs/authors.md is true: every name of the ports is on it, and the clocks are those of the processes."""

import re
from dataclasses import fields

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.robot import behaviour
from actors.robot.behaviour import (
    Decision,
    Door,
    ExchangeSettings,
    FloorPlan,
    Goal,
    Navigation,
    PlaceMonitor,
    Plan,
    Positioning,
    Start,
    View,
)
from actors.robot.behaviour.goal import AbortReason, GoalOrder, GoalPhase, GoalStatus
from actors.task.words import PlaceKey
from cleaning.adaptive import AdaptiveCleaningRobot
from deeco import Knowledge, in_seconds, role
from deeco.immutability import fault
from deeco.process import Periodic, processes_of
from deeco.replication.schema import RoleBook

PAGE = (REPOSITORY / "docs" / "authors.md").read_text()


def said() -> set[str]:
    """Every name that begins what stands in backticks."""
    return {word for quoted in re.findall(r"`([^`]+)`", PAGE) for word in re.findall(r"\w+", quoted)}


@pytest.mark.parametrize("port", [Positioning, Navigation, PlaceMonitor, FloorPlan, Plan, Door])
def test_every_name_of_a_port_is_on_the_page(port: type) -> None:
    names = {
        name for name in (*vars(port), *getattr(port, "__annotations__", ())) if not name.startswith("_")
    }
    assert names and names - said() == set()


def test_every_field_and_every_public_name_is_on_the_page() -> None:
    wanted = {one.name for kind in (Start, Decision, ExchangeSettings) for one in fields(kind)}
    wanted |= {*View._fields, *Goal._fields, *behaviour.__all__}
    wanted |= {one.name for kind in (GoalStatus, AbortReason, GoalPhase) for one in kind}
    assert wanted - {GoalOrder.__name__, "BehaviourError"} - said() == set()


def test_the_clocks_are_those_of_the_processes() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (\d+) (ms|s) \| (\d) \|$", PAGE, re.MULTILINE)
    told = {
        name: (int(every) / (1000 if unit == "ms" else 1), int(order)) for name, every, unit, order in rows
    }
    true = {
        process.name: (in_seconds(process.schedule.every), process.schedule.order)
        for process in processes_of(AdaptiveCleaningRobot)
        if isinstance(process.schedule, Periodic)
    }
    assert told == true


def test_a_place_key_travels_in_knowledge_and_a_struct_that_can_change_does_not() -> None:
    @role
    class Wishing(Knowledge):
        wish: PlaceKey | None = None
        others: tuple[PlaceKey, ...] = ()

    book = RoleBook([Wishing])
    told = Wishing(id="r1", wish=PlaceKey("r2", 3), others=(PlaceKey("r1", 0),))
    unpacked = book.unpack("r1", book.pack(told))
    assert unpacked is not None and unpacked.roles == (told,)

    class Loose(msgspec.Struct):
        place: int

    assert "not among the types" in (fault(Loose) or "")
