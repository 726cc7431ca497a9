"""The cleaning task: robots visit places that are given to them."""

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Final, Literal, TypeVar

from msgspec import Meta

from actors.floor.grid import OccupancyGrid
from actors.floor.placement import PlacementError, draw_points
from actors.geometry import Point
from actors.runtime.errors import AcrcError
from actors.settings import Names, Place, Settings
from actors.task.task import (
    DrawInput,
    JudgeSetup,
    MarkStyle,
    Metric,
    Task,
    TaskDeclaration,
)
from cleaning import visits
from cleaning.place import GOLDEN, VisitReport
from cleaning.referee import COLUMNS, Referee

T = TypeVar("T")
_MOST_PLACES: Final = 1000
_SPACING: Final = 0.6
"""Minimum distance of one robot's drawn places from walls and each other, m. A robot can pass between such a
place and the wall."""
_DEFAULT_PLACES: Final = 10
"""Default number of places of a robot (d3scomp/deeco-adaptation-testbed, GARBAGE_PER_ROBOT)."""


class PlacesTable(Settings, frozen=True):
    """[places]: the places to be cleaned."""

    preset: Literal["golden", "areas", "free", "listed"] | None = None
    """areas: random in `areas`; free: random on all reachable floor; listed: in [[robot]] tables; golden:
    those of the original testbed for r1 to r4, for others as if absent. Absent: areas if the scenario has
    any, else free."""
    areas: Names | None = None
    """Areas of random places, weighted by surface; absent: all of the scenario."""
    per_robot: Annotated[int, Meta(ge=0, le=_MOST_PLACES)] | None = None
    """Places of each robot; absent: 10, as in the original testbed."""


class CleaningTask(Task):
    """Robots visit places; a place counts as done if a robot was there and reported it."""

    declaration = TaskDeclaration(
        name="cleaning",
        table="places",
        item="place",
        items="places",
        done="cleaned",
        metrics=(
            Metric(
                "places",
                "places done",
                "places",
                "places_done",
                rank=1,
                worst=0.0,
                margin=1.0,
                total="places_total",
                reported="places_claimed",
            ),
            Metric(
                "settled", "running time", "s", "settled_s", "less", "done or given up", rank=2, margin=10.0
            ),
            Metric("completion", "time to complete", "s", "completion_s", "less", "done", margin=10.0),
        ),
        marks={
            "open": MarkStyle("ring", "place not cleaned, in its owner's colour", True),
            "given": MarkStyle("diamond", "place added during the run", True),
            "done": MarkStyle("disc", "cleaned place: outline of its owner, fill of its cleaner"),
            "given up": MarkStyle("cross", "place given up, or reported but not cleaned"),
        },
        events={"cleaned": MarkStyle("tick", "place cleaned, in its owner's colour")},
        columns=COLUMNS,
        baseline="none",
        cells={
            "places cleaned": ("places_done", "places_total"),
            "reported": ("places_reported", "places_total"),
            "given up": ("places_given_up",),
            "finished at": ("completion_s",),
        },
    )
    settings = PlacesTable
    report = VisitReport
    kernels = (visits,)

    def judge(self, setup: JudgeSetup) -> Referee:
        """Return the referee."""
        return Referee(setup)

    def draw(self, settings: PlacesTable, placing: DrawInput) -> tuple[Place, ...]:
        """Return the places of a robot by preset. Raises AcrcError without room."""
        count = _DEFAULT_PLACES if settings.per_robot is None else settings.per_robot
        if settings.preset == "golden" and placing.index < len(GOLDEN):
            return _golden_places(placing, count)
        if count == 0:
            return ()
        areas = self.areas(settings, [(area.name, area) for area in placing.areas])
        try:
            points = draw_points(
                placing.grid,
                count,
                rng=placing.generator("places", placing.robot),
                clearance=_SPACING,
                apart=_SPACING,
                start=placing.start.point,
                passage=placing.radius,
                areas=[area for _, area in areas] or None,
            )
        except PlacementError as error:
            where = "in places.areas" if areas else "on all free floor"
            raise AcrcError(
                f"cannot draw {count} places for robot {placing.robot} {where}: {error}"
            ) from error
        return tuple((round(point.x, 3), round(point.y, 3)) for point in points)

    def check(self, item: Place, grid: OccupancyGrid) -> str | None:
        """Return the fault of a place that is not on free floor."""
        return None if grid.is_free(Point(*item)) else "be on free floor"

    def point(self, item: Place) -> Point:
        """Return the place."""
        return Point(*item)

    def listed(self, settings: PlacesTable) -> PlacesTable:
        """Return the settings with the preset `listed`."""
        return PlacesTable(preset="listed")

    def settings_fault(
        self, settings: PlacesTable, robots: Sequence[str], listed: Collection[str], areas: Sequence[str]
    ) -> str | None:
        """Return the first conflict between the preset and other keys."""
        preset = settings.preset
        if settings.areas is not None and preset in ("free", "listed"):
            return f'places.areas must be absent with places.preset "{preset}"'
        if preset == "areas" and not areas:
            return 'places.preset is "areas", but the scenario has no [[area]] table'
        if preset != "listed":
            return None
        if settings.per_robot is not None:
            return f'places.per_robot is {settings.per_robot}, but must be absent with places.preset "listed"'
        missing = next((robot for robot in robots if robot not in listed), None)
        return missing and (
            f'places.preset is "listed", but {missing} has no places; list them in its [[robot]] table'
        )

    def draw_keys(self, settings: PlacesTable, *, has_areas: bool) -> Mapping[str, str]:
        """Return a preset of random places in place of one that is made for the map."""
        return {"preset": "areas" if has_areas else "free"} if settings.preset == "golden" else {}

    def areas(self, settings: PlacesTable, areas: Sequence[tuple[str, T]]) -> Sequence[tuple[str, T]]:
        """Return the areas in which places are drawn; empty: on all free floor."""
        if settings.preset == "free":
            return ()
        if settings.areas is None:
            return areas
        known = dict(areas)
        return [(name, known[name]) for name in settings.areas]


def _golden_places(placing: DrawInput, count: int) -> tuple[Place, ...]:
    points = GOLDEN[placing.index]
    if count > len(points):
        raise AcrcError(
            f'places.per_robot is {count}, but must be at most {len(points)} where places.preset is "golden"'
        )
    for index, point in enumerate(points[:count]):
        if not placing.grid.is_free(point):
            raise AcrcError(
                f"place {index} of robot {placing.robot} is at ({point.x:g}, {point.y:g}), but must be on "
                f'free floor of {placing.map}; places.preset "golden" is made for the map corridor'
            )
    return tuple((point.x, point.y) for point in points[:count])
