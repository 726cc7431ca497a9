"""Where a fleet's own strategy may be loaded from."""

from pathlib import Path

from actors.robot.behaviour.foreign import Permit, admitted
from cleaning.strategies import entry
from deploy.fleet.fleet_file import Fleet


def own_code(fleet: Fleet, permit: Permit) -> tuple[Path, ...]:
    """Its folders, none for one that is installed. Raises as `foreign.admitted` does."""
    hints = (Path(fleet.run.modules),) if fleet.run.modules else ()
    return admitted(fleet.path, entry(fleet.run.strategy), hints, permit)
