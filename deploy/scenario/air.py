"""From a scenario's tables of the air to what the radio's process is told."""

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.instant import milliseconds
from actors.radio.propagation.interferers import WifiParameters
from actors.radio.propagation.walls import WallPatch, inside
from actors.radio.radio_setup import RadioSetup
from actors.runtime.errors import AcrcError
from deploy.scenario.tables import Scenario


def check_walls(grid: OccupancyGrid, scenario: Scenario) -> None:
    """Raise AcrcError if a table [[wall]] holds nothing that is occupied."""
    for index, (patch, table) in enumerate(zip(_patches(scenario), scenario.wall, strict=True)):
        if not (grid.cells[inside(grid, patch)] == OCCUPIED).any():
            (x0, x1), (y0, y1) = table.x, table.y
            raise AcrcError(
                f"wall[{index}] spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g} m, where nothing is occupied,"
                " but must hold a wall"
            )


def radio_setup(scenario: Scenario, addresses: tuple[tuple[str, int], ...]) -> RadioSetup:
    """What the radio is told: robots with their short addresses, the preset, what differs from it."""
    radio = scenario.radio
    return RadioSetup(
        seed=scenario.run.seed_of("radio"),
        step_us=milliseconds(scenario.run.step_ms),
        robots=addresses,
        preset=radio.preset,
        map=scenario.map,
        walls=radio.walls,
        patches=_patches(scenario),
        shadowing_db=radio.shadowing_db,
        correlation_distance=radio.correlation_distance,
        channel=radio.channel,
        wifi=tuple(
            WifiParameters(*station.at, station.channel, station.duty, station.power_dbm)
            for station in scenario.wifi
        ),
    )


def _patches(scenario: Scenario) -> tuple[WallPatch, ...]:
    return tuple(WallPatch(table.material, table.x, table.y) for table in scenario.wall)
