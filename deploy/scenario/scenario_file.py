"""Scenario files: read with the command line's overrides and checked; the files and the map they name."""

import difflib
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from actors import wording
from actors.floor import offices
from actors.floor.map_file import load_map, read_header
from actors.floor.offices import OfficesError
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError, typed, wrong_value
from actors.robot.behaviour import handover
from actors.robot.behaviour.foreign import is_installed
from actors.robot.behaviour.loading import located
from actors.robot.navigation.navigator import NAVIGATION_PRESETS
from actors.robot.stack import IMPROVED_REMOVED
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import located_model
from actors.settings import ParameterError, decode, loads, read_text, toml_tables
from deploy.scenario import events
from deploy.scenario.events import area_fault, robot_fault
from deploy.scenario.tables import AreaTable, Scenario

DEFAULT_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"


@dataclass(frozen=True)
class Overrides:
    """Values from the command line in place of the file's: a number or its text; None = as in the file."""

    robots: int | str | None = None
    """Replaces robots.count."""
    seed: int | str | None = None
    """Replaces run.seed."""
    key: str | None = None
    """Replaces run.key."""
    duration: float | str | None = None
    """Replaces run.duration, s."""
    step: int | str | None = None
    """Replaces run.step_ms, ms."""
    strategy: str | None = None
    """Replaces run.strategy; if the file names another one, its table [strategy] is left out, too."""
    navigation: str | None = None
    """Replaces navigation.preset."""
    settings: tuple[tuple[str, Any], ...] = ()
    """Replace other keys, such as ("deeco.publish", 0.5): dotted keys, and values as the file would have."""


_KEYS: Final = {
    "robots": ("robots", "count"),
    "seed": ("run", "seed"),
    "key": ("run", "key"),
    "duration": ("run", "duration"),
    "step": ("run", "step_ms"),
    "strategy": ("run", "strategy"),
    "navigation": ("navigation", "preset"),
}
"""Where each field of Overrides stands in the file."""
_TEXTS: Final = {"strategy", "key", "navigation"}


def load_scenario(path: Path | None = None, overrides: Overrides = Overrides()) -> Scenario:
    """The scenario in the file, or the one that is shipped, with what the command line sets instead.

    Paths in it are absolute. Raises AcrcError, or OptionError where a value of `overrides` is wrong.
    """
    path = DEFAULT_SCENARIO if path is None else path
    check_there(path, DEFAULT_SCENARIO.parent)
    return parse(read_text(path, "scenario"), path, overrides)


def parse(text: str, path: Path, overrides: Overrides = Overrides()) -> Scenario:
    """The scenario in the text of the file `path`, as load_scenario gives it."""
    content = toml_tables(text, path)
    if says_study(content):
        carried_out = typed("campaign", path)
        raise AcrcError(f"{path}: is a study, must be a scenario; to carry the study out: {carried_out}")
    own_map = content.get("map")
    options = _lay_over(content, overrides)
    try:
        scenario = decode(Scenario, content)
    except ParameterError as error:
        option = options.get(tuple(error.key.split(".")))
        if option is not None and error.right:
            raise wrong_value(option, error.value, error.right) from None
        raise (OptionError(f"{option}: {error}") if option else AcrcError(f"{path}: {error}")) from None
    scenario = _on_its_map(scenario, own_map, path, options)
    try:
        fault = robot_fault(scenario) or area_fault(scenario) or events.fault(scenario)
        _ = scenario.stack
    except AcrcError as error:
        fault = str(error)
    if fault:
        raise AcrcError(f"{path}: {fault}")
    return _with_absolute_paths(scenario, Path(os.path.realpath(path)).parent)


def _on_its_map(
    scenario: Scenario, own: object, path: Path, options: Mapping[tuple[str, ...], str]
) -> Scenario:
    """The scenario with its map located, and without what is of the file's `own` map if that is another.

    Raises AcrcError or OptionError where the map cannot be drawn, or is not what starts and places are for.
    """
    folder, option = Path(os.path.realpath(path)).parent, options.get(("map",))
    try:
        there = map_of(scenario.map, folder)
        moved = isinstance(own, str) and map_of(own, folder) != there
    except OfficesError as error:
        raise OptionError(f"{option}: {error}") if option else AcrcError(f"{path}: map {error}") from None
    if moved and (fault := bound(scenario, str(own), options)):
        raise OptionError(f"{option}: {fault}")
    scenario = replace(scenario, map=there)
    return with_areas(scenario, own_areas=not moved or ("area",) in options)


def _lay_over(content: dict[str, Any], overrides: Overrides) -> Mapping[tuple[str, ...], str]:
    """Set what `overrides` sets in `content`, and give the option that each such key comes from."""
    options: dict[tuple[str, ...], str] = {}
    if overrides.navigation == "improved":
        raise OptionError(f"--navigation: {IMPROVED_REMOVED}")
    if overrides.navigation not in {None, *NAVIGATION_PRESETS}:
        raise wrong_value("--navigation", overrides.navigation, wording.one_of(tuple(NAVIGATION_PRESETS)))
    _leave_settings_out(content, overrides.strategy)
    for dotted, value in overrides.settings:
        place = tuple(dotted.split("."))
        _set(content, place, value, dotted)
        options[place] = f"--set {dotted}"
    for name, (table_name, key) in _KEYS.items():
        value = getattr(overrides, name)
        table = content.setdefault(table_name, {})
        if value is not None and isinstance(table, dict):
            table[key] = value if name in _TEXTS else _number(value)
            options[table_name, key] = f"--{name}"
    return options


def _set(content: dict[str, Any], place: Sequence[str], value: object, dotted: str) -> None:
    """Set a key in its table, which may be missing. OptionError where there is something else."""
    table: Any = content
    for name in place[:-1]:
        table = table.setdefault(name, {}) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not all(place):
        raise wrong_value("--set", dotted, "a key of a table, such as deeco.publish")
    table[place[-1]] = value


def settings(words: Sequence[str]) -> tuple[tuple[str, Any], ...]:
    """The settings that a command line gives, each KEY=VALUE with a value of TOML, or else a bare text.

    OptionError for what has no key.
    """
    given: list[tuple[str, Any]] = []
    for word in words:
        key, equals, text = word.partition("=")
        if not key.strip() or not equals:
            raise wrong_value("--set", word, "a key and a value, such as deeco.publish=0.5")
        try:
            value = loads(f"value = {text}")["value"]
        except (ValueError, KeyError):
            value = text.strip()
        given.append((key.strip(), value))
    return tuple(given)


def _leave_settings_out(content: dict[str, Any], strategy: str | None) -> None:
    """Drop the table [strategy] if it holds the settings of another strategy than the one that is wished."""
    run = content.get("run")
    named = run.get("strategy") if isinstance(run, dict) else None
    if strategy is not None and named is not None and named != strategy:
        content.pop("strategy", None)


def _number(value: float | str) -> float | str:
    """The number that a text holds, or else the text, which the scenario's tables then refuse."""
    if not isinstance(value, str):
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


def _with_absolute_paths(scenario: Scenario, folder: Path) -> Scenario:
    """Paths as they are meant: relative to the scenario file's folder."""
    return with_models(
        replace(scenario, run=replace(scenario.run, modules=str(folder / (scenario.run.modules or ".")))),
        lambda model: located_model(model, folder),
    )


def with_models(scenario: Scenario, moved: Callable[[str], str]) -> Scenario:
    """Return the scenario with other names or paths of its robot models."""
    robots = replace(scenario.robots, model=moved(scenario.robots.model))
    own = tuple(
        robot if robot.model is None else replace(robot, model=moved(robot.model)) for robot in scenario.robot
    )
    return replace(scenario, robots=robots, robot=own)


def module_folders(scenario: Scenario) -> tuple[Path, ...]:
    """Where a scenario says that its strategy lies."""
    return (Path(scenario.run.modules),) if scenario.run.modules else ()


def map_of(told: str, folder: Path) -> str:
    """Return the map that the scenario file in `folder` means by a path or a name. Raises OfficesError."""
    return offices.parse(told).name if offices.is_name(told) else os.path.realpath(folder / told)


def bound(scenario: Scenario, own: str, given: Collection[tuple[str, ...]]) -> str | None:
    """Return the parts of a file, made for its `own` map, that do not fit the scenario's; None if all fit.

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
    return scenario if tables == scenario.area else replace(scenario, area=tables)


def title(told: str) -> str:
    """Return the map's short name."""
    return Path(told).name.removesuffix(".yaml")


def is_scenario(path: Path) -> bool:
    """True if a file is a scenario; False if it cannot be read."""
    try:
        content = toml_tables(read_text(path, "scenario"), path)
    except AcrcError:
        return False
    return "map" in content and not says_study(content)


def says_study(content: Mapping[str, Any]) -> bool:
    """True if a file with this content is a study: it must have both keys, and a scenario has neither."""
    return "strategies" in content and "scenario" in content


def check_there(path: Path, folder: Path) -> None:
    """Raise AcrcError with the file of `folder`, of those that are shipped, that one who typed this may mean.

    Not where the file exists, and not where none is called like it.
    """
    if path.exists():
        return
    shipped = {file.stem: file for file in sorted(folder.glob("*.toml"))}
    for near in difflib.get_close_matches(path.stem, shipped, n=1):
        raise AcrcError(f"{path}: there is no such file; did you mean {os.path.relpath(shipped[near])}?")


def map_files(described: Path) -> Iterator[Path]:
    """Yield the map's YAML file and its image. Raises MapError for an invalid map."""
    load_map(described)
    yield described
    yield read_header(described).image


def strategy_files(strategy: str, folder: Path) -> Iterator[Path]:
    """The modules of a strategy of one's own, which lies in `folder`; of a package all of it.

    Nothing for what is installed. Raises AcrcError where one lies elsewhere.
    """
    for name in handover.names(strategy):
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
