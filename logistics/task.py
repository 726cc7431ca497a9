"""The logistics task: robots with batteries carry orders between stations and share chargers."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from actors.floor.grid import OccupancyGrid
from actors.floor.placement import PlacementError, draw_points
from actors.geometry import Point
from actors.portable import draws
from actors.runtime.errors import AcrcError
from actors.settings import Place
from actors.task.task import DrawInput, JudgeSetup, MarkStyle, Metric, Task, TaskDeclaration
from logistics.demand import LogisticsTable
from logistics.items import Charger, Item, Report, Station
from logistics.judge import COLUMNS, REACH, LogisticsJudge

_SPACING: Final = 0.8
"""Distance of drawn stations and chargers from walls, m: robots pass behind one that stands there."""
_APART: Final = 2.5
"""Distance between them, m: three robots can stand between two."""


class Logistics(Task):
    """Robots carry orders between stations; they arrive during the run and have deadlines."""

    declaration = TaskDeclaration(
        name="logistics",
        table="logistics",
        item="order",
        items="orders",
        done="delivered",
        has_initial_work=False,
        metrics=(
            Metric(
                *("delivered", "orders delivered", "orders", "orders_delivered"),
                rank=1,
                worst=0.0,
                total="orders_total",
            ),
            Metric("late", "orders late", "orders", "orders_late", "less", rank=2),
            Metric("lateness", "lateness of all orders so far", "s", "lateness_s", "less"),
            Metric("empty", "robots that ran empty", "robots", "robots_empty", "less"),
            Metric("queueing", "waiting for chargers", "s", "queueing_s", "less"),
            Metric("charging", "time at chargers", "s", "charging_s", "less"),
            Metric("completion", "time to deliver all", "s", "completion_s", "less", "delivered"),
        ),
        marks={
            "station": MarkStyle("square", "station"),
            "station out of order": MarkStyle("heavy cross", "closed station"),
            "charger": MarkStyle("soft ring", "charger"),
            "charger in use": MarkStyle("filled ring", "charger in use"),
            "charger out of order": MarkStyle("heavy cross", "failed charger"),
            "waiting": MarkStyle("disc", "order at its first station, in its owner's colour", True),
            "carried": MarkStyle("ring", "carried order, shown at its destination", True),
        },
        events={
            "picked up": MarkStyle("triangle", "order picked up"),
            "delivered": MarkStyle("tick", "order delivered"),
            "late": MarkStyle("cross", "deadline of an order passed"),
        },
        columns=COLUMNS,
        causes={"charging": ("#2f9e8f", ".."), "waiting for a charger": ("#b5651d", "++")},
        cells={
            "delivered": ("orders_delivered",),
            "late": ("orders_late",),
            "charging, s": ("charging_s",),
            "queueing, s": ("queueing_s",),
        },
        baseline="logistics-greedy",
    )
    settings = LogisticsTable
    item = Item
    report = Report
    reach = REACH
    kernels = (draws,)

    def judge(self, setup: JudgeSetup) -> LogisticsJudge:
        """Return the judge."""
        return LogisticsJudge(setup)

    def draw(self, settings: LogisticsTable, placing: DrawInput) -> tuple[Any, ...]:
        """Return stations and chargers, equal for all robots: as listed, else drawn. Raises AcrcError."""
        stations, chargers = settings.stations, settings.chargers
        stations = stations or _drawn("stations", settings.station_count, placing, chargers)
        chargers = chargers or _drawn("chargers", settings.charger_count, placing, stations)
        return (*(Station(*point) for point in stations), *(Charger(*point) for point in chargers))

    def check(self, item: Item, grid: OccupancyGrid) -> str | None:
        """Return the fault of a listed item."""
        if not isinstance(item, Station | Charger):
            return "be a station or a charger; orders arrive during the run"
        return None if grid.is_free(Point(item.x, item.y)) else "be on free floor"

    def point(self, item: Item) -> Point | None:
        """Return the point of a station or charger."""
        return Point(item.x, item.y) if isinstance(item, Station | Charger) else None

    def settings_fault(
        self, settings: LogisticsTable, robots: Sequence[str], listed: Collection[str], areas: Sequence[str]
    ) -> str | None:
        """Return the first fault: stations of some robots only, or an outage of what does not exist."""
        if listed and len(listed) < len(robots):
            return "some [[robot]] tables list stations; list them for all robots or none, or in [logistics]"
        stations = len(settings.stations) or settings.station_count
        chargers = len(settings.chargers) or settings.charger_count
        for index, one in enumerate(settings.outages):
            for kind, number, count in ("station", one.station, stations), ("charger", one.charger, chargers):
                if number is not None and number >= count and not listed:
                    return f"logistics.outages[{index}].{kind} is {number}, but must be below {count}"
        return None

    def draw_keys(self, settings: LogisticsTable, *, has_areas: bool) -> Mapping[str, Any]:
        """Return empty lists in place of listed stations and chargers."""
        return {name: [] for name in ("stations", "chargers") if getattr(settings, name)}


def _drawn(kind: str, count: int, placing: DrawInput, others: Sequence[Place]) -> tuple[Place, ...]:
    try:
        points = draw_points(
            placing.grid,
            count,
            rng=placing.generator("task", kind),
            clearance=_SPACING,
            apart=_APART,
            keep_off=[Point(*point) for point in others],
            passage=placing.radius,
            areas=placing.areas or None,
        )
    except PlacementError as error:
        raise AcrcError(f"cannot draw {count} {kind}: {error}") from error
    return tuple((round(point.x, 3), round(point.y, 3)) for point in points)
