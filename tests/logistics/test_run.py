"""Runs of the logistics task in memory."""

import math
from itertools import combinations
from pathlib import Path

import pytest
from msgspec.structs import replace

from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.simulated_runs import read_run
from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.tables import Scenario, to_toml
from logistics.bound import delivery_bound
from tests.helpers import in_memory
from tests.recorded_runs import record

HALL = """
map = "../maps/corridor.yaml"
task.use = "logistics"
localisation.preset = "odometry"
run = { seed = 2, duration = %(duration)s, strategy = "logistics-%(strategy)s" }
[robots]
count = 2
odometry = "exact"
battery = %(battery)s
start = [[8.0, 12.0, 0.0], [9.0, 12.6, 0.0]]
[logistics]
stations = [[7.0, 12.0], [12.0, 12.6]]
chargers = [[10.0, 12.0], [13.3, 12.0]]
rate = 6.0
"""


def hall(strategy: str = "greedy", battery: float = 0.5, duration: float = 60.0) -> Scenario:
    """Return a scenario of two robots in the hall of the corridor."""
    text = HALL % {"strategy": strategy, "battery": battery, "duration": duration}
    return parse(text, REPOSITORY / "scenarios" / "of_a_test.toml")


def of(strategy: str, battery: float) -> RunResult:
    """Return the result of a run in the hall, of which no run delivers more than the bound."""
    chosen = hall(strategy, battery)
    with in_memory(chosen) as (_, result):
        assert value(result, "orders_delivered") <= delivery_bound(resolve(chosen).world)
        return result


def value(result: RunResult, name: str) -> float:
    """Return a number of the task's result."""
    found = result.task[name]
    assert isinstance(found, float | int)
    return found


def test_a_run_shows_its_orders(tmp_path: Path) -> None:
    result = record(tmp_path / "run", hall("auction"))
    assert result.task["orders_delivered"] == 2 and result.task["reports_refused"] == 0
    run = read_run(tmp_path / "run")
    states = dict[str, list[str]]()
    for _, one in run.marks:
        states.setdefault(str(one.key), []).append(one.state)
    assert states["station/0"] == ["station"] and states["charger/0"][:2] == ["charger", "charger in use"]
    assert sum(one == ["waiting", "carried", ""] for one in states.values()) == 2
    assert {"picked up", "delivered", "charging"} <= {one.kind for one in run.task_events}
    copied = parse((tmp_path / "run" / "scenario.toml").read_text(), tmp_path / "run" / "scenario.toml")
    assert resolve(copied).world.robots[0].items[2] == ("charger", 10.0, 12.0)
    again = record(tmp_path / "again", copied)
    assert again.digest == result.digest and again.task == result.task


def test_knowledge_about_busy_chargers_saves_queueing() -> None:
    greedy, threshold = of("greedy", 0.019), of("threshold", 0.019)
    assert value(greedy, "queueing_s") > 50.0 and value(threshold, "queueing_s") < 5.0
    assert value(threshold, "charging_s") > 1.8 * value(greedy, "charging_s")


def test_a_robot_with_an_empty_battery_stops() -> None:
    result = of("greedy", 0.003)
    assert result.task["robots_empty"] == 1 and value(result, "first_empty_s") < 30.0
    (empty,) = (one for one in result.per_robot.values() if one.energy and one.energy.empty_s is not None)
    assert empty.energy and empty.energy.charge == 0.0 and (empty.driven_m or 0.0) < 3.0


@pytest.mark.parametrize("name", ["logistics", "warehouse"])
def test_shipped_scenarios(name: str) -> None:
    chosen = load_scenario(REPOSITORY / "scenarios" / f"{name}.toml")
    world = resolve(chosen).world
    assert delivery_bound(world) > 20
    without = replace(world, duration_us=world.duration_us // 2)
    assert delivery_bound(without) < delivery_bound(world)
    few = replace(world, robots=world.robots[:1])
    assert delivery_bound(few) <= delivery_bound(world)
    assert to_toml(chosen) == to_toml(load_scenario(REPOSITORY / "scenarios" / f"{name}.toml"))


def test_stations_are_drawn_alike_for_all_robots() -> None:
    drawn = REPOSITORY / "scenarios" / "logistics.toml"
    chosen = load_scenario(
        drawn, Overrides(settings=(("logistics.stations", []), ("logistics.chargers", [])))
    )
    robots = resolve(chosen).world.robots
    assert all(one.items == robots[0].items for one in robots) and len(robots[0].items) == 8
    points = [(x, y) for _, x, y in robots[0].items]
    assert all(math.dist(a, b) > 2.4 for a, b in combinations(points, 2))


def test_chargers_of_all_robots_must_be_on_free_floor() -> None:
    shipped = REPOSITORY / "scenarios" / "logistics.toml"
    wrong = load_scenario(shipped, Overrides(settings=(("logistics.chargers", [[0.0, 0.0]]),)))
    with pytest.raises(AcrcError, match=r'robot r1 is \["charger", 0.0, 0.0\], but must be on free floor'):
        resolve(wrong)
