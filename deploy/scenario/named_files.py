"""Files behind a name in a scenario, a study or a fleet: of a map also its image, of a strategy its code."""

from collections.abc import Iterator
from pathlib import Path

from actors.floor.map_file import load_map
from actors.floor.map_header import read_header
from actors.robot.behaviour import succession
from actors.robot.behaviour.foreign import is_installed
from actors.robot.behaviour.modules import located
from actors.runtime.errors import AcrcError


def map_files(described: Path) -> Iterator[Path]:
    """The map's YAML file and its image. Raises MapError for what is no map: it does not travel as one."""
    load_map(described)
    yield described
    yield read_header(described).image


def strategy_files(strategy: str, folder: Path) -> Iterator[Path]:
    """The modules of a strategy of one's own, which lies in `folder`; of a package all of it.

    Nothing for what is installed. Raises AcrcError where one lies elsewhere.
    """
    for name in succession.names(strategy):
        module = name.partition(":")[0]
        if is_installed(module):
            continue
        top = located(module.partition(".")[0], folder)
        if top is None:
            raise AcrcError(f"{name}: its module does not lie in {folder}; must do so to be bundled")
        whole = top.name == "__init__.py" or top.is_dir()
        files = sorted((top if top.is_dir() else top.parent).rglob("*.py")) if whole else [top]
        for file in files:
            if not file.is_file() or not file.resolve().is_relative_to(folder.resolve()):
                raise AcrcError(f"{file}: leads out of {folder}, or is no file; must lie there to be bundled")
        yield from files
