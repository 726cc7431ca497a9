"""Which floor a scenario is on, a map file's or a drawn one; and what of a scenario is of one map alone."""

import os
from collections.abc import Collection
from pathlib import Path

from actors.floor import offices
from deploy.scenario.adaptation_tables import AreaTable
from deploy.scenario.tables import Scenario


def located(told: str, folder: Path) -> str:
    """The map that the scenario file in `folder` means by a path or a name. Raises OfficesError."""
    return offices.parse(told).name if offices.is_name(told) else os.path.realpath(folder / told)


def bound(scenario: Scenario, own: str, given: Collection[tuple[str, ...]]) -> str | None:
    """What of a file, made for its `own` map, has no meaning on the scenario's; None if nothing.

    `given`: the keys that were not taken from the file.
    """
    robots = any(robot.start is not None or robot.places is not None for robot in scenario.robot)
    made = {
        ("robots", "start"): ("robots.start=[]", bool(scenario.robots.start)),
        ("places", "preset"): ("places.preset=free", scenario.places.preset == "golden"),
        ("robot",): ("robot=[]", robots),
    }
    right = [words for key, (words, there) in made.items() if there and key not in given]
    if not right:
        return None
    return (
        f"{scenario.map} is another map than the scenario's own {own}, for which its starts or places are"
        f" made; must be set together with {' and '.join(right)}"
    )


def with_areas(scenario: Scenario, *, own_areas: bool) -> Scenario:
    """The scenario with the areas of its floor: its own tables if of that floor, else a drawn one's rooms."""
    tables = scenario.area if own_areas else ()
    if not tables and offices.is_name(scenario.map):
        rooms = offices.office_floor(scenario.map).rooms
        tables = tuple(
            AreaTable(name=room.name, x=(room.x0, room.x1), y=(room.y0, room.y1)) for room in rooms
        )
    return scenario if tables == scenario.area else scenario.model_copy(update={"area": tables})


def title(told: str) -> str:
    """What people call the map."""
    return Path(told).name.removesuffix(".yaml")
