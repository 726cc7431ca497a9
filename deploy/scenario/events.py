"""Events of a scenario: checks between them and other tables, and the orders that they become."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from actors import orders
from actors.floor.grid import OccupancyGrid
from actors.floor.placement import Area, areas_named, has_free_floor
from actors.geometry import wrap
from actors.instant import Instant, in_seconds, milliseconds, seconds
from actors.orders import Order
from actors.runtime.errors import AcrcError
from actors.wording import shown
from actors.world.world_setup import TimedOrder
from deploy.scenario.tables import AreaTable, EventTable, Scenario


def robot_fault(scenario: Scenario) -> str | None:
    """Return an error in the [[robot]] and [places] tables, without a full stop; None if valid."""
    return _ids(scenario) or _places(scenario)


def _ids(scenario: Scenario) -> str | None:
    seen: set[str] = set()
    for index, robot in enumerate(scenario.robot):
        if robot.id not in scenario.ids:
            return f'robot[{index}].id is "{robot.id}", but must be {known_robots(scenario)}'
        if robot.id in seen:
            return f'robot[{index}].id is a second "{robot.id}"; give each robot one table'
        seen.add(robot.id)
    return None


def _places(scenario: Scenario) -> str | None:
    if scenario.places.preset != "listed":
        return None
    if scenario.places.per_robot is not None:
        return (
            f'places.per_robot is {scenario.places.per_robot}, but must be absent with places.preset "listed"'
        )
    listed = {robot.id for robot in scenario.robot if robot.places is not None}
    for robot in scenario.ids:
        if robot not in listed:
            return f'places.preset is "listed", but {robot} has no places; list them in its [[robot]] table'
    return None


def known_robots(scenario: Scenario) -> str:
    """Describe the valid robot ids."""
    first, last = scenario.ids[0], scenario.ids[-1]
    return f"the only robot, {first}" if first == last else f"one of the robots {first} to {last}"


def area_fault(scenario: Scenario) -> str | None:
    """Return an error in the areas or their use, without a full stop; None if valid."""
    return (
        _once([area.name for area in scenario.area], "area[{}].name", "each area must have its own name")
        or _known(scenario.robots.areas, "robots.areas", scenario)
        or _preset(scenario)
        or _known(scenario.places.areas, "places.areas", scenario)
    )


def for_starts(scenario: Scenario) -> tuple[Area, ...] | None:
    """Return the areas in which starts are drawn; None: on all free floor."""
    names = scenario.robots.areas
    return None if names is None else areas_named(tuple(table.area for table in scenario.area), names)


def for_places(scenario: Scenario) -> tuple[Area, ...] | None:
    """Return the areas in which places are drawn; None: on all free floor."""
    return tuple(table.area for table in of_places(scenario)) or None


def of_places(scenario: Scenario) -> tuple[AreaTable, ...]:
    """Return the tables of the areas in which places are drawn; empty: on all free floor."""
    if scenario.places.preset == "free":
        return ()
    if scenario.places.areas is None:
        return scenario.area
    tables = {table.name: table for table in scenario.area}
    return tuple(tables[name] for name in scenario.places.areas)


def check_areas(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if an area contains no free floor."""
    for index, area in enumerate(table.area for table in scenario.area):
        if not has_free_floor(grid, area):
            raise AcrcError(
                f"area[{index}] {shown(area.name)} spans x {area.x0:g} to {area.x1:g} and"
                f" y {area.y0:g} to {area.y1:g} m, where nothing is free; it must cover free floor"
            )


def _preset(scenario: Scenario) -> str | None:
    preset, names = scenario.places.preset, scenario.places.areas
    if names is not None and preset in ("free", "listed"):
        return f'places.areas must be absent with places.preset "{preset}"'
    if preset == "areas" and not scenario.area:
        return 'places.preset is "areas", but the scenario has no [[area]] table'
    return None


def _known(names: Sequence[str] | None, key: str, scenario: Scenario) -> str | None:
    """Return an error for an unknown or repeated area name."""
    known = [area.name for area in scenario.area]
    for index, name in enumerate(names or ()):
        if name in known:
            continue
        near = difflib.get_close_matches(name, known, n=1)
        if near:
            return f"{key}[{index}] is {shown(name)}, which is not an area; did you mean {shown(near[0])}?"
        right = f"one of {', '.join(map(shown, known))}" if known else "the name of an [[area]]"
        return f"{key}[{index}] is {shown(name)}, but must be {right}"
    return _once(names or (), f"{key}[{{}}]", "name each area once")


def _once(names: Sequence[str], key: str, rule: str) -> str | None:
    """Return an error for a repeated name; `key` has a placeholder for its index."""
    for index, name in enumerate(names):
        if name in names[:index]:
            return f"{key.format(index)} is a second {shown(name)}; {rule}"
    return None


_ORDERS: Final[Mapping[str, tuple[tuple[str, ...], Callable[..., Order]]]] = {
    "kill": ((), orders.Kill),
    "freeze": ((), orders.Freeze),
    "thaw": ((), orders.Thaw),
    "restart": ((), orders.Restart),
    "move": (("to",), lambda robot, to: orders.Move(robot, to[0], to[1], wrap(to[2]))),
    "jam": (("radius", "duration"), lambda at, radius, s: orders.StartJam(at[0], at[1], radius, seconds(s))),
    "lose": (("of",), orders.Lose),
    "obstacle": (("radius",), lambda at, radius: orders.Obstacle(at[0], at[1], radius)),
    "give": (("places",), orders.Give),
    "close": ((), lambda at: orders.CloseDoor(*at)),
    "open": ((), lambda at: orders.OpenDoor(*at)),
}
"""Keys that each action requires, and the order made of its values."""
_COMPANIONS: Final = ("to", "radius", "duration", "of", "places")
_WITH_ROBOT: Final = ("kill", "freeze", "thaw", "restart", "move", "lose", "give")


def fault(scenario: Scenario) -> str | None:
    """Return the first error in the events, without a full stop; None if valid."""
    for index, event in enumerate(scenario.event):
        found = _shape(event) or _robot(event, scenario) or _instant(event, scenario)
        if found:
            return f"event[{index}]{found}"
    return _sequence(scenario)


def timed_orders(scenario: Scenario) -> tuple[TimedOrder, ...]:
    """Return the orders sorted by time; orders of one instant keep the order of the file."""
    return tuple(_timed(scenario.event[index]) for index in _by_instant(scenario))


def _timed(event: EventTable) -> TimedOrder:
    return TimedOrder(seconds(event.at), _order(event))


def action_of(event: EventTable) -> str:
    """Return the name of the event's action."""
    return next(name for name in _ORDERS if getattr(event, name) is not None)


def _shape(event: EventTable) -> str | None:
    """Return an error unless the event has one action and exactly its keys."""
    actions = [name for name in _ORDERS if getattr(event, name) is not None]
    if len(actions) != 1:
        has = " and ".join(actions) or "no action"
        return f" has {has}, but must have exactly one of {', '.join(_ORDERS)}"
    (action,) = actions
    needed, _ = _ORDERS[action]
    for name in _COMPANIONS:
        present, belongs = getattr(event, name) is not None, name in needed
        if belongs and not present:
            return f".{name} is missing; {action} requires {' and '.join(needed)}"
        if present and not belongs:
            needs = " and ".join(needed) or "no other key"
            return f".{name} cannot be used with {action}, which takes {needs}"
    return None


def _robot(event: EventTable, scenario: Scenario) -> str | None:
    action = action_of(event)
    if action in _WITH_ROBOT and getattr(event, action) not in scenario.ids:
        return f'.{action} is "{getattr(event, action)}", but must be {known_robots(scenario)}'
    if event.lose is not None and (event.of not in scenario.ids or event.of == event.lose):
        return f'.of is "{event.of}", but must be {known_robots(scenario)}, and not {event.lose}'
    return None


def _instant(event: EventTable, scenario: Scenario) -> str | None:
    if _boundary(event, scenario) < seconds(scenario.run.duration):
        return None
    last = in_seconds(_last_boundary(scenario))
    return f".at is {event.at:g}, but must be from 0 to {last:g} s, where the last step begins"


def _sequence(scenario: Scenario) -> str | None:
    """Return an error if a robot's state does not allow an order at its time."""
    states = dict.fromkeys(scenario.ids, "running")
    restarted: dict[str, Instant] = {}
    for index in _by_instant(scenario):
        event = scenario.event[index]
        action, boundary = action_of(event), _boundary(event, scenario)
        if action not in ("kill", "freeze", "thaw", "restart"):
            continue
        robot: str = getattr(event, action)
        if action != "restart" and restarted.get(robot) == boundary:
            return (
                f"event[{index}] cannot {action} {robot} at {event.at:g} s, the step of its restart;"
                " choose a later step"
            )
        allowed, after = _TRANSITIONS[action]
        if states[robot] not in allowed:
            return (
                f"event[{index}] cannot {action} {robot} at {event.at:g} s: it is {states[robot]} then;"
                f" it must be {' or '.join(allowed)}"
            )
        states[robot] = after
        if action == "restart":
            restarted[robot] = boundary
    return None


_TRANSITIONS: Final = {
    "kill": (("running", "frozen"), "killed"),
    "freeze": (("running",), "frozen"),
    "thaw": (("frozen",), "running"),
    "restart": (("running", "frozen", "killed"), "running"),
}
"""Robot states that allow each action, and the state after it."""


def _by_instant(scenario: Scenario) -> list[int]:
    """Return the indices of the events, sorted by time."""
    return sorted(range(len(scenario.event)), key=lambda index: seconds(scenario.event[index].at))


def _boundary(event: EventTable, scenario: Scenario) -> Instant:
    """Return the first step boundary not before the event."""
    step = milliseconds(scenario.run.step_ms)
    return Instant(_timed(event).step(step) * step)


def _last_boundary(scenario: Scenario) -> Instant:
    step = milliseconds(scenario.run.step_ms)
    return Instant(math.ceil(seconds(scenario.run.duration) / step - 1) * step)


def _order(event: EventTable) -> Order:
    action = action_of(event)
    beside, order = _ORDERS[action]
    return order(*(getattr(event, name) for name in (action, *beside)))
