"""Checks of the tables [[robot]], [places] and [[area]] of a scenario, and the areas that a table means."""

import difflib
from collections.abc import Sequence

from actors.floor.grid import OccupancyGrid
from actors.floor.placement import Area, areas_named, has_free_floor
from actors.runtime.errors import AcrcError
from actors.wording import shown
from deploy.scenario.adaptation_tables import AreaTable
from deploy.scenario.tables import Scenario


def robot_fault(scenario: Scenario) -> str | None:
    """Return the fault between the tables, without a full stop; None if there is none."""
    return _ids(scenario) or _places(scenario)


def _ids(scenario: Scenario) -> str | None:
    seen: set[str] = set()
    for index, robot in enumerate(scenario.robot):
        if robot.id not in scenario.ids:
            return f'robot[{index}].id is "{robot.id}", but must be {known_robots(scenario)}'
        if robot.id in seen:
            return f'robot[{index}].id is "{robot.id}" once more, but each robot must have one table only'
        seen.add(robot.id)
    return None


def _places(scenario: Scenario) -> str | None:
    if scenario.places.preset != "listed":
        return None
    if scenario.places.per_robot is not None:
        return (
            f"places.per_robot is {scenario.places.per_robot}, but must be left out where"
            ' places.preset is "listed"'
        )
    listed = {robot.id for robot in scenario.robot if robot.places is not None}
    for robot in scenario.ids:
        if robot not in listed:
            return (
                f'places.preset is "listed", but {robot} lists none: a [[robot]] table must hold its places'
            )
    return None


def known_robots(scenario: Scenario) -> str:
    """The robots there are, for a sentence."""
    first, last = scenario.ids[0], scenario.ids[-1]
    return f"the only robot, {first}" if first == last else f"one of the robots {first} to {last}"


def area_fault(scenario: Scenario) -> str | None:
    """Return the fault of the areas or their use, without a full stop; None if there is none."""
    return (
        _once([area.name for area in scenario.area], "area[{}].name", "each area must have a name of its own")
        or _known(scenario.robots.areas, "robots.areas", scenario)
        or _preset(scenario)
        or _known(scenario.places.areas, "places.areas", scenario)
    )


def for_starts(scenario: Scenario) -> tuple[Area, ...] | None:
    """Where starts are drawn; None: on all free floor."""
    names = scenario.robots.areas
    return None if names is None else areas_named(tuple(table.area for table in scenario.area), names)


def for_places(scenario: Scenario) -> tuple[Area, ...] | None:
    """Where places are drawn; None: on all free floor."""
    return tuple(table.area for table in of_places(scenario)) or None


def of_places(scenario: Scenario) -> tuple[AreaTable, ...]:
    """The tables of the areas in which places are drawn; none: on all free floor."""
    if scenario.places.preset == "free":
        return ()
    if scenario.places.areas is None:
        return scenario.area
    tables = {table.name: table for table in scenario.area}
    return tuple(tables[name] for name in scenario.places.areas)


def check_areas(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if an area holds no free floor at all."""
    for index, area in enumerate(table.area for table in scenario.area):
        if not has_free_floor(grid, area):
            raise AcrcError(
                f"area[{index}] {shown(area.name)} spans x {area.x0:g} to {area.x1:g} and"
                f" y {area.y0:g} to {area.y1:g} m, where nothing is free, but must hold free floor"
            )


def _preset(scenario: Scenario) -> str | None:
    preset, names = scenario.places.preset, scenario.places.areas
    if names is not None and preset in ("free", "listed"):
        return f'places.areas must be left out where places.preset is "{preset}"'
    if preset == "areas" and not scenario.area:
        return 'places.preset is "areas", but there is none: the scenario must hold tables [[area]]'
    return None


def _known(names: Sequence[str] | None, key: str, scenario: Scenario) -> str | None:
    """A name that no area has, or that stands there twice."""
    known = [area.name for area in scenario.area]
    for index, name in enumerate(names or ()):
        if name in known:
            continue
        near = difflib.get_close_matches(name, known, n=1)
        if near:
            return f"{key}[{index}] is {shown(name)}, which is no area; did you mean {shown(near[0])}?"
        right = f"one of {', '.join(map(shown, known))}" if known else "the name of an [[area]]"
        return f"{key}[{index}] is {shown(name)}, but must be {right}"
    return _once(names or (), f"{key}[{{}}]", "each area must stand there once only")


def _once(names: Sequence[str], key: str, rule: str) -> str | None:
    """A name that stands in `names` a second time; `key` has a gap for its index."""
    for index, name in enumerate(names):
        if name in names[:index]:
            return f"{key.format(index)} is {shown(name)} once more, but {rule}"
    return None
