"""Where robots start and which places they clean: what a scenario gives, and seeded draws for the rest."""

from collections.abc import Sequence
from dataclasses import dataclass

from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import OccupancyGrid
from actors.floor.placement import PlacementError, check_pose, draw_points
from actors.geometry import Point, wrap
from actors.randomness import generator
from actors.robot_model import OdometryKind
from actors.runtime.errors import AcrcError
from cleaning.place import GOLDEN
from deploy.scenario import events
from deploy.scenario.tables import RobotTable, Scenario


class SpotError(AcrcError):
    """Robots or places that the floor plan has no room for."""


@dataclass(frozen=True)
class Spacing:
    """How far from everything else robots and places are drawn."""

    clearance: float = 0.6
    """From walls, m. Default: a robot can pass between the point and the wall."""
    apart: float = 0.6
    """From each other, centre to centre, m: of the robots' starts, and of one robot's places. Default: as
    `clearance`."""
    per_robot: int = 10
    """Places of a robot unless the scenario says. Default: d3scomp/deeco-adaptation-testbed,
    GARBAGE_PER_ROBOT."""


@dataclass(frozen=True)
class RobotSpec:
    """One robot's kind, before it has a start and places."""

    id: str
    model: str
    sensor: str
    odometry: OdometryKind
    radius: float
    own: RobotTable


def starts(
    grid: OccupancyGrid, figures: Sequence[RobotSpec], scenario: Scenario, spacing: Spacing = Spacing()
) -> list[tuple[float, float, float]]:
    """Every robot's first pose, in order: as given, or drawn at a distance from all that are given."""
    given: dict[str, tuple[float, float, float]] = {}
    for index, figure in enumerate(figures):
        pose = figure.own.start
        if pose is None and index < len(scenario.robots.start):
            pose = scenario.robots.start[index]
        if pose is not None:
            check_pose(grid, Point(*pose[:2]), figure.radius, figure.id)
            given[figure.id] = (pose[0], pose[1], wrap(pose[2]))
    _check_apart([figure for figure in figures if figure.id in given], given)
    taken = [Point(*pose[:2]) for pose in given.values()]
    floor = taken[0] if taken else None
    for figure in figures:
        if figure.id in given:
            continue
        point = _draw_start(grid, figure, scenario, spacing, taken, floor)
        taken.append(point)
        given[figure.id] = (*_to_the_millimetre(point), 0.0)
    return [given[figure.id] for figure in figures]


def _draw_start(
    grid: OccupancyGrid,
    figure: RobotSpec,
    scenario: Scenario,
    spacing: Spacing,
    taken: Sequence[Point],
    floor: Point | None,
) -> Point:
    try:
        (point,) = draw_points(
            grid,
            1,
            rng=generator(scenario.run.seed_of("placement"), "start", figure.id),
            clearance=max(spacing.clearance, figure.radius),
            apart=max(spacing.apart, 2 * figure.radius),
            keep_off=taken,
            start=floor,
            passage=figure.radius,
            areas=events.for_starts(scenario),
        )
    except PlacementError as error:
        where = "" if scenario.robots.areas is None else " in robots.areas"
        raise SpotError(
            f"robot {figure.id} finds no start{where} beside {len(taken)} others: {error}"
        ) from error
    return point


def _check_apart(figures: Sequence[RobotSpec], given: dict[str, tuple[float, float, float]]) -> None:
    for index, figure in enumerate(figures):
        here = Point(*given[figure.id][:2])
        for other in figures[:index]:
            gap, needed = here.distance_to(Point(*given[other.id][:2])), figure.radius + other.radius
            if gap < needed:
                raise SpotError(
                    f"robots {other.id} and {figure.id} would start {gap:.3f} m apart at"
                    f" ({here.x:g}, {here.y:g}), but must be at least {needed:.3f} m apart"
                )


def check_events(grid: OccupancyGrid, figures: Sequence[RobotSpec], scenario: Scenario) -> None:
    """Raise an AcrcError if an event puts a robot or a place into a wall."""
    radius = {figure.id: figure.radius for figure in figures}
    for index, event in enumerate(scenario.event):
        if event.move is not None and event.to is not None:
            check_pose(grid, Point(*event.to[:2]), radius[event.move], event.move)
        for x, y in event.places or ():
            if not grid.is_free(Point(x, y)):
                raise SpotError(f"event[{index}].places has ({x:g}, {y:g}), but must be on free floor")


def check_doors(grid: OccupancyGrid, figures: Sequence[RobotSpec], scenario: Scenario) -> None:
    """Raise SpotError for a door that there is not, or that is to close or open when it is so already."""
    doorways = Doorways(grid, max(figure.radius for figure in figures))
    closed: set[int] = set()
    for index, event in sorted(enumerate(scenario.event), key=lambda item: item[1].at):
        point, verb = event.close or event.open, "open" if event.close is None else "close"
        if point is None:
            continue
        try:
            door = doorways.at(Point(*point))
            doorways.closed(door)
        except DoorError as error:
            raise SpotError(f"event[{index}].{verb} is no door: {error}") from None
        if (door.index in closed) == (verb == "close"):
            state = "closed" if verb == "close" else "open"
            raise SpotError(f"event[{index}] would {verb} a door at {event.at:g} s, which is {state} then")
        closed ^= {door.index}


def places(
    grid: OccupancyGrid,
    figure: RobotSpec,
    start: tuple[float, float, float],
    scenario: Scenario,
    spacing: Spacing = Spacing(),
) -> tuple[tuple[float, float], ...]:
    """The robot's places: its own, or those that the preset means."""
    if figure.own.places is not None:
        return _checked(grid, figure, figure.own.places, f"of {scenario.map}")
    index = scenario.ids.index(figure.id)
    count = spacing.per_robot if scenario.places.per_robot is None else scenario.places.per_robot
    if scenario.places.preset == "golden" and index < len(GOLDEN):
        where = f'of {scenario.map}; places.preset "golden" is made for the map corridor'
        return _checked(grid, figure, _golden(index, count), where)
    if count == 0:
        return ()
    chosen = events.for_places(scenario)
    try:
        points = draw_points(
            grid,
            count,
            rng=generator(scenario.run.seed_of("placement"), "places", figure.id),
            clearance=spacing.clearance,
            apart=spacing.apart,
            start=Point(*start[:2]),
            passage=figure.radius,
            areas=chosen,
        )
    except PlacementError as error:
        where = "on all free floor" if chosen is None else "in places.areas"
        raise SpotError(f"robot {figure.id} cannot get its {count} places {where}: {error}") from error
    return tuple(map(_to_the_millimetre, points))


def _to_the_millimetre(point: Point) -> tuple[float, float]:
    """So that people can read and repeat it."""
    return round(point.x, 3), round(point.y, 3)


def _golden(index: int, count: int) -> Sequence[tuple[float, float]]:
    points = GOLDEN[index]
    if count > len(points):
        raise SpotError(
            f'places.per_robot is {count}, but must be at most {len(points)} where places.preset is "golden"'
        )
    return points[:count]


def _checked(
    grid: OccupancyGrid, figure: RobotSpec, points: Sequence[tuple[float, float]], where: str
) -> tuple[tuple[float, float], ...]:
    """The points; SpotError for one that is not on free floor, `where` that should be."""
    for index, (x, y) in enumerate(points):
        if not grid.is_free(Point(x, y)):
            raise SpotError(
                f"place {index} of robot {figure.id} is at ({x:g}, {y:g}), but must be on free floor {where}"
            )
    return tuple((x, y) for x, y in points)
