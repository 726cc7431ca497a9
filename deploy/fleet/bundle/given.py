"""What a robot is given of its fleet: fleet file, map, robot models, its own keys, its strategy's code."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from actors import toml_file
from actors.robot.behaviour.foreign import Permit
from actors.robot.behaviour.modules import FOLDERS
from actors.runtime import regular_file
from actors.runtime.access.credentials import PRIVATE_KEY_FILE
from actors.runtime.access.tls import AUTHORITY_FILE, CERTIFICATE_FILE
from actors.runtime.errors import AcrcError
from deploy.fleet.bundle.archive import PRIVATE, BundledFile
from deploy.fleet.doctor import robot as checks
from deploy.fleet.doctor.machine import Machine
from deploy.fleet.fleet_file import Fleet, FleetRobot, own_code
from deploy.scenario.named_files import map_files, strategy_files

FOLDER: Final = "fleets"
"""Of the program, for all that only the base may see: a robot's sandbox hides the folder of this name."""
FILE: Final = f"{FOLDER}/fleet.toml"
"""A link to the fleet file, which has one name on every robot."""
MODULES: Final = "modules"
"""Folder of the program for a strategy of one's own."""


def check(fleet: Fleet, robot: FleetRobot, permit: Permit) -> None:
    """Raise AcrcError with what the robot's doctor would find wrong; makes the robot's behaviour once."""
    for findings in (
        checks.floor(fleet, robot),
        checks.behaviour(fleet, robot, permit),
        checks.keys(Machine(), fleet, robot),
    ):
        for found in findings:
            if not found.ok:
                raise AcrcError(f"{found.subject}: {found.text}")


def fleet_files(fleet: Fleet, robot: FleetRobot) -> tuple[dict[str, BundledFile], str]:
    """The files by their place in the program, and where the link FILE leads.

    They stand to one another as they do here. Raises AcrcError for a path that only this computer knows.
    """
    told = toml_file.tables(toml_file.read(fleet.path, "fleet"), fleet.path)
    folder = fleet.path.parent

    def here(named: str) -> Path:
        if Path(named).is_absolute():
            raise AcrcError(
                f"{fleet.path}: names {named}; must be relative to the fleet file, so that the robot finds it"
            )
        return Path(os.path.normpath(folder / named))

    places = {fleet.path: 0o644}
    places |= {Path(os.path.normpath(path)): 0o644 for path in map_files(here(told["map"]))}
    models = (one.get("model", "") for one in told["robot"])
    places |= {here(model): 0o644 for model in models if model.endswith(".toml")}
    if robot.listen is not None:
        own = here(told.get("keys", fleet.keys.name)) / robot.id
        places |= {own / name: PRIVATE for name in (AUTHORITY_FILE, CERTIFICATE_FILE, PRIVATE_KEY_FILE)}
    top = os.path.commonpath([place.parent for place in places])
    names = {place: f"files/{place.relative_to(top).as_posix()}" for place in places}
    files = {f"{FOLDER}/{names[one]}": BundledFile(regular_file.content(one), places[one]) for one in places}
    return files, names[fleet.path]


def modules(fleet: Fleet, permit: Permit) -> dict[str, BundledFile]:
    """The code of a strategy of one's own, and whatever that has loaded when it was checked; else nothing."""
    folders = own_code(fleet, permit)
    if len(folders) > 1:
        both = " and ".join(map(str, folders))
        raise AcrcError(f"{fleet.path}: its strategies lie in {both}; must lie in one folder to be bundled")
    found = {path for folder in folders for path in _code(fleet.run.strategy, folder)}
    return {
        f"{MODULES}/{path.relative_to(folders[0]).as_posix()}": BundledFile(regular_file.content(path))
        for path in found
    }


def _code(strategy: str, folder: Path) -> Iterator[Path]:
    yield from strategy_files(strategy, folder)
    loaded: Sequence[str] = tuple(FOLDERS.hashes())
    yield from (folder / name for name in loaded)
