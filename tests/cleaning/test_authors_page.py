"""docs/authors.md is true: every name of the ports is on it, and the clocks are those of the processes."""

import re
from dataclasses import fields
from pathlib import Path

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
from actors.task.task import REASON_LIMIT, PlaceGivenUp, PlaceKey, PlaceReport
from cleaning.adaptive import AdaptiveCleaningRobot
from deeco import in_seconds
from deeco.component import Periodic, processes_of
from tests.recorded_runs import record

PAGE = (REPOSITORY / "docs" / "authors.md").read_text()


def said() -> set[str]:
    """Every name in backticks, without the blocks of code."""
    text = re.sub(r"^```.*?^```$", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    return {word for quoted in re.findall(r"`([^`]+)`", text) for word in re.findall(r"\w+", quoted)}


@pytest.mark.parametrize("port", [Positioning, Navigation, PlaceMonitor, FloorPlan, Plan, Door])
def test_every_name_of_a_port_is_on_the_page(port: type) -> None:
    names = {
        name for name in (*vars(port), *getattr(port, "__annotations__", ())) if not name.startswith("_")
    }
    assert names and names - said() == set()


def test_every_field_and_every_public_name_is_on_the_page() -> None:
    wanted = {one.name for kind in (Start, Decision, ExchangeSettings) for one in fields(kind)}
    wanted |= {one for kind in (PlaceKey, PlaceReport, PlaceGivenUp) for one in kind.__struct_fields__}
    wanted |= {"PlaceReport", "PlaceGivenUp", *View._fields, *Goal._fields, *behaviour.__all__}
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


def test_a_behaviour_without_the_component_model_cleans_its_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert f"at most {REASON_LIMIT} characters" in PAGE
    text = re.findall(r"^```python\n(# my_study/in_order.py\n.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0]
    (tmp_path / "authors_in_order.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    result = record(tmp_path / "out", robots=1, duration=45.0, strategy="authors_in_order:behaviour")
    assert result.places_done == result.places_claimed > 0
    assert result.places_lost == 0
