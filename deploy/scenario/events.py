"""Robots, areas and events of a scenario: checks across tables, and conversion of events to orders."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from actors import orders
from actors.floor.grid import OccupancyGrid
from actors.floor.placement import has_free_floor
from actors.geometry import wrap
from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.orders import Order
from actors.runtime.errors import AcrcError
from actors.settings import decode
from actors.task.loading import decode_items, load_task, named_faults
from actors.task.task import Task
from actors.wording import toml_text
from actors.world.world_setup import TimedOrder
from deploy.scenario.tables import AreaTable, EventTable, Scenario, SwarmFile


def robot_fault(scenario: Scenario) -> str | None:
    """Return an error in the [[robot]] tables and those of the task, without a full stop; None if valid.

    Raises AcrcError for items of another type.
    """
    ids = [robot.id for robot in scenario.robot]
    for index, robot in enumerate(ids):
        if robot not in scenario.ids:
            return f'robot[{index}].id is "{robot}", but must be {known_robots(scenario)}'
    return repetition_fault(ids, "robot[{}].id", "give each robot one table") or _task_fault(scenario)


def _task_fault(scenario: Scenario) -> str | None:
    task, settings = scenario_task(scenario)
    given = [(f"robot[{index}]", one.items) for index, one in enumerate(scenario.robot)]
    given += [(f"event[{index}]", one.items) for index, one in enumerate(scenario.event)]
    for key, items in given:
        decode_items(task, items or (), f"{key}.{scenario.table}")
    listed = [robot.id for robot in scenario.robot if robot.items is not None]
    with named_faults(task, "settings_fault"):
        return task.settings_fault(settings, scenario.ids, listed, [area.name for area in scenario.area])


def scenario_task(scenario: Scenario) -> tuple[Task, Any]:
    """Return the scenario's task and its settings. Raises AcrcError."""
    task = load_task(scenario.task.use)
    return task, decode(task.settings, scenario.task_settings, scenario.table)


def known_robots(scenario: Scenario) -> str:
    """Describe the valid robot ids."""
    first, last = scenario.ids[0], scenario.ids[-1]
    return f"the only robot, {first}" if first == last else f"one of the robots {first} to {last}"


def area_fault(scenario: Scenario) -> str | None:
    """Return an error in the areas or their use, without a full stop; None if valid."""
    (_, settings), people = scenario_task(scenario), scenario.people
    fault = (
        area_repetition_fault(scenario)
        or _area_name_fault(scenario.robots.areas, "robots.areas", scenario)
        or _area_name_fault(getattr(settings, "areas", None), f"{scenario.table}.areas", scenario)
    )
    if fault or people is None:
        return fault
    if people.between == "areas" and not (people.area or scenario.area):
        return 'people.between is "areas", but the scenario has none; add [[area]] tables'
    return _area_name_fault(people.areas, "people.areas", scenario)


def people_area_tables(scenario: Scenario) -> tuple[AreaTable, ...]:
    """Return the tables of the areas between which people walk; empty: not between areas."""
    people = scenario.people
    if people is None or people.between != "areas":
        return ()
    if people.area or people.areas is None:
        return people.area or scenario.area
    tables = {table.name: table for table in scenario.area}
    return tuple(tables[name] for name in people.areas)


def item_area_tables(scenario: Scenario) -> tuple[AreaTable, ...]:
    """Return the tables of the areas in which the task draws items; empty: on all free floor."""
    task, settings = scenario_task(scenario)
    return tuple(table for _, table in task.areas(settings, [(one.name, one) for one in scenario.area]))


def check_areas(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if an area contains no free floor."""
    for index, area in enumerate(scenario.areas):
        if not has_free_floor(grid, area):
            raise AcrcError(
                f"area[{index}] {toml_text(area.name)} spans x {area.x0:g} to {area.x1:g} and"
                f" y {area.y0:g} to {area.y1:g} m, where nothing is free; it must cover free floor"
            )


def _area_name_fault(names: Sequence[str] | None, key: str, scenario: Scenario) -> str | None:
    """Return an error for an unknown or repeated area name."""
    known = [area.name for area in scenario.area]
    for index, name in enumerate(names or ()):
        if name in known:
            continue
        matches = difflib.get_close_matches(name, known, n=1)
        if matches:
            nearest = toml_text(matches[0])
            return f"{key}[{index}] is {toml_text(name)}, which is not an area; did you mean {nearest}?"
        expected = f"one of {', '.join(map(toml_text, known))}" if known else "the name of an [[area]]"
        return f"{key}[{index}] is {toml_text(name)}, but must be {expected}"
    return repetition_fault(names or (), f"{key}[{{}}]", "name each area once")


def area_repetition_fault(file: SwarmFile) -> str | None:
    """Return an error for a repeated name of an area."""
    names = [area.name for area in file.area]
    return repetition_fault(names, "area[{}].name", "each area must have its own name")


def repetition_fault(names: Sequence[str], key: str, rule: str) -> str | None:
    """Return an error for a repeated name; `key` has a placeholder for its index."""
    for index, name in enumerate(names):
        if name in names[:index]:
            return f"{key.format(index)} is a second {toml_text(name)}; {rule}"
    return None


_ACTIONS: Final[Mapping[str, tuple[tuple[str, ...], Callable[..., Order]]]] = {
    "kill": ((), orders.Kill),
    "freeze": ((), orders.Freeze),
    "thaw": ((), orders.Thaw),
    "restart": ((), orders.Restart),
    "move": (("to",), lambda robot, to: orders.Move(robot, to[0], to[1], wrap(to[2]))),
    "jam": (("radius", "duration"), lambda at, radius, s: orders.StartJam(at[0], at[1], radius, seconds(s))),
    "lose": (("of",), orders.LoseFrame),
    "obstacle": (("radius",), lambda at, radius: orders.Obstacle(at[0], at[1], radius)),
    "give": (("items",), orders.ItemAssignment),
    "close": ((), lambda at: orders.CloseDoor(*at)),
    "open": ((), lambda at: orders.OpenDoor(*at)),
}
"""Further keys that each action requires, and the constructor of its order."""
_FURTHER_KEYS: Final = ("to", "radius", "duration", "of", "items")
_ROBOT_ACTIONS: Final = ("kill", "freeze", "thaw", "restart", "move", "lose", "give")


def event_fault(scenario: Scenario) -> str | None:
    """Return the first error in the events, without a full stop; None if valid."""
    for index, event in enumerate(scenario.event):
        fault = (
            _action_fault(event, scenario.table)
            or _robot_fault(event, scenario)
            or _instant_fault(event, scenario)
        )
        if fault:
            return f"event[{index}]{fault}"
    return _sequence_fault(scenario)


def timed_orders(scenario: Scenario) -> tuple[TimedOrder, ...]:
    """Return the orders sorted by time; orders of one instant keep the order of the file."""
    return tuple(_timed_order(scenario.event[index]) for index in _sorted_indices(scenario))


def _timed_order(event: EventTable) -> TimedOrder:
    action = action_of(event)
    further_keys, order = _ACTIONS[action]
    values = [getattr(event, name) for name in (action, *further_keys)]
    return TimedOrder(seconds(event.at), order(*values))


def action_of(event: EventTable) -> str:
    """Return the name of the event's action."""
    return next(name for name in _ACTIONS if getattr(event, name) is not None)


def _action_fault(event: EventTable, items: str) -> str | None:
    """Return an error unless the event has one action and exactly the keys of that action.

    `items`: key of items in the file.
    """
    actions = [name for name in _ACTIONS if getattr(event, name) is not None]
    if len(actions) != 1:
        has = " and ".join(actions) or "no action"
        return f" has {has}, but must have exactly one of {', '.join(_ACTIONS)}"
    (action,) = actions
    needed = [items if name == "items" else name for name in _ACTIONS[action][0]]
    for key in _FURTHER_KEYS:
        name = items if key == "items" else key
        is_present, is_allowed = getattr(event, key) is not None, name in needed
        if is_allowed and not is_present:
            return f".{name} is missing; {action} requires {' and '.join(needed)}"
        if is_present and not is_allowed:
            takes = " and ".join(needed) or "no other key"
            return f".{name} cannot be used with {action}, which takes {takes}"
    return None


def _robot_fault(event: EventTable, scenario: Scenario) -> str | None:
    action = action_of(event)
    if action in _ROBOT_ACTIONS and getattr(event, action) not in scenario.ids:
        return f'.{action} is "{getattr(event, action)}", but must be {known_robots(scenario)}'
    if event.lose is not None and (event.of not in scenario.ids or event.of == event.lose):
        return f'.of is "{event.of}", but must be {known_robots(scenario)}, and not {event.lose}'
    return None


def _instant_fault(event: EventTable, scenario: Scenario) -> str | None:
    step, duration = milliseconds(scenario.run.step_ms), seconds(scenario.run.duration)
    if _step_start(event, scenario) < duration:
        return None
    last = in_seconds(Instant(math.ceil(duration / step - 1) * step))
    return f".at is {event.at:g}, but must be from 0 to {last:g} s, where the last step begins"


def _sequence_fault(scenario: Scenario) -> str | None:
    """Return an error if a robot's state does not allow an order at its time."""
    states = dict.fromkeys(scenario.ids, "running")
    restarted: dict[str, Instant] = {}
    for index in _sorted_indices(scenario):
        event = scenario.event[index]
        action, step_start = action_of(event), _step_start(event, scenario)
        if action not in ("kill", "freeze", "thaw", "restart"):
            continue
        robot: str = getattr(event, action)
        if action != "restart" and restarted.get(robot) == step_start:
            return (
                f"event[{index}] cannot {action} {robot} at {event.at:g} s, the step of its restart;"
                " choose a later step"
            )
        allowed, next_state = _TRANSITIONS[action]
        if states[robot] not in allowed:
            return (
                f"event[{index}] cannot {action} {robot} at {event.at:g} s: it is {states[robot]} then;"
                f" it must be {' or '.join(allowed)}"
            )
        states[robot] = next_state
        if action == "restart":
            restarted[robot] = step_start
    return None


_TRANSITIONS: Final = {
    "kill": (("running", "frozen"), "killed"),
    "freeze": (("running",), "frozen"),
    "thaw": (("frozen",), "running"),
    "restart": (("running", "frozen", "killed"), "running"),
}
"""Robot states that allow each action, and the state after it."""


def _sorted_indices(scenario: Scenario) -> list[int]:
    """Return the indices of the events, sorted by time."""
    return sorted(range(len(scenario.event)), key=lambda index: seconds(scenario.event[index].at))


def _step_start(event: EventTable, scenario: Scenario) -> Instant:
    """Return the first step boundary not before the event."""
    step = milliseconds(scenario.run.step_ms)
    return Instant(_timed_order(event).step(step) * step)
