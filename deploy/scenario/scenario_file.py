"""Scenario files: loading, overrides of the command line, checks, and the files that they name."""

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
from actors.installation.usage import OptionError, command_line, wrong_value
from actors.robot.behaviour import handover
from actors.robot.navigation.navigator import NAVIGATION_PRESETS
from actors.robot.stack import IMPROVED_REMOVED
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import resolve_model
from actors.settings import ParameterError, loads, read_text, toml_tables
from actors.user_code import is_installed, module_file
from deploy.scenario.events import area_fault, event_fault, robot_fault, scenario_task
from deploy.scenario.tables import AreaTable, Scenario, decode_swarm_file

DEFAULT_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"


@dataclass(frozen=True)
class Overrides:
    """Values from the command line that replace the file's, as number or text; None: not replaced."""

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
    """Replaces run.strategy. If the file has another strategy, its [strategy] table is ignored."""
    navigation: str | None = None
    """Replaces navigation.preset."""
    settings: tuple[tuple[str, Any], ...] = ()
    """Other keys to replace, dotted, with values as in the file, such as ("deeco.publish", 0.5)."""


_KEYS: Final = {
    "robots": ("robots", "count"),
    "seed": ("run", "seed"),
    "key": ("run", "key"),
    "duration": ("run", "duration"),
    "step": ("run", "step_ms"),
    "strategy": ("run", "strategy"),
    "navigation": ("navigation", "preset"),
}
"""Key of each field of Overrides."""
_TEXT_FIELDS: Final = {"strategy", "key", "navigation"}


def load_scenario(path: Path | None = None, overrides: Overrides = Overrides()) -> Scenario:
    """Load a scenario file (default: the shipped `chapter`) and apply the command line's overrides.

    Paths in the result are absolute. Raises AcrcError, or OptionError for a wrong value of `overrides`.
    """
    path = DEFAULT_SCENARIO if path is None else path
    check_exists(path, DEFAULT_SCENARIO.parent)
    return parse(read_text(path, "scenario"), path, overrides)


def parse(text: str, path: Path, overrides: Overrides = Overrides()) -> Scenario:
    """Return the scenario in the text of the file `path`, like load_scenario."""
    content = toml_tables(text, path)
    if is_study(content):
        raise AcrcError(f"{path}: is a study, not a scenario; run it with: {command_line('campaign', path)}")
    own_map = content.get("map")
    options = _apply_overrides(content, overrides)
    try:
        scenario = decode_swarm_file(Scenario, content)
    except ParameterError as error:
        option = options.get(tuple(error.key.split(".")))
        if option is not None and error.expected:
            raise wrong_value(option, error.value, error.expected) from None
        raise (OptionError(f"{option}: {error}") if option else AcrcError(f"{path}: {error}")) from None
    except AcrcError as error:
        raise AcrcError(f"{path}: {error}") from None
    scenario = _with_map(scenario, own_map, path, options)
    try:
        fault = robot_fault(scenario) or area_fault(scenario) or event_fault(scenario)
        _ = scenario.stack
    except AcrcError as error:
        fault = str(error)
    if fault:
        raise AcrcError(f"{path}: {fault}")
    folder = Path(os.path.realpath(path)).parent
    run = replace(scenario.run, modules=str(folder / (scenario.run.modules or ".")))
    return with_models(replace(scenario, run=run), lambda model: resolve_model(model, folder))


def _with_map(
    scenario: Scenario, own_map: object, path: Path, options: Mapping[tuple[str, ...], str]
) -> Scenario:
    """Resolve the scenario's map; drop the file's areas if the command line has replaced its map `own_map`.

    Without areas, the rooms of a drawn floor are the areas.
    Raises AcrcError or OptionError if the map cannot be drawn, or starts or places belong to another map.
    """
    folder, option = Path(os.path.realpath(path)).parent, options.get(("map",))
    try:
        location = map_location(scenario.map, folder)
        is_replaced = isinstance(own_map, str) and map_location(own_map, folder) != location
    except OfficesError as error:
        raise OptionError(f"{option}: {error}") if option else AcrcError(f"{path}: map {error}") from None
    if is_replaced and (fault := map_conflict(scenario, str(own_map), options)):
        raise OptionError(f"{option}: {fault}")
    tables = () if is_replaced and ("area",) not in options else scenario.area
    if not tables and offices.is_name(location):
        rooms = offices.office_floor(location).rooms
        tables = tuple(
            AreaTable(name=room.name, x=(room.x0, room.x1), y=(room.y0, room.y1)) for room in rooms
        )
    return replace(scenario, map=location, area=tables)


def _apply_overrides(content: dict[str, Any], overrides: Overrides) -> Mapping[tuple[str, ...], str]:
    """Apply `overrides` to `content`; return the option that set each key."""
    options: dict[tuple[str, ...], str] = {}
    if overrides.navigation == "improved":
        raise OptionError(f"--navigation: {IMPROVED_REMOVED}")
    if overrides.navigation not in {None, *NAVIGATION_PRESETS}:
        raise wrong_value("--navigation", overrides.navigation, wording.one_of(tuple(NAVIGATION_PRESETS)))
    run = content.get("run")
    file_strategy = run.get("strategy") if isinstance(run, dict) else None
    if overrides.strategy is not None and file_strategy not in (None, overrides.strategy):
        content.pop("strategy", None)  # the settings of another strategy
    for dotted, value in overrides.settings:
        keys = tuple(dotted.split("."))
        _set_key(content, keys, value, dotted)
        options[keys] = f"--set {dotted}"
    for name, (table_name, key) in _KEYS.items():
        value = getattr(overrides, name)
        table = content.setdefault(table_name, {})
        if value is not None and isinstance(table, dict):
            table[key] = value if name in _TEXT_FIELDS else _number(value)
            options[table_name, key] = f"--{name}"
    return options


def _set_key(content: dict[str, Any], keys: Sequence[str], value: object, dotted: str) -> None:
    """Set a key in its table, which may be missing. Raises OptionError if a parent is not a table."""
    table: Any = content
    for name in keys[:-1]:
        table = table.setdefault(name, {}) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not all(keys):
        raise wrong_value("--set", dotted, "a key of a table, such as deeco.publish")
    table[keys[-1]] = value


def parse_settings(words: Sequence[str]) -> tuple[tuple[str, Any], ...]:
    """Parse settings of the form KEY=VALUE; a value that is not valid TOML is a string.

    Raises OptionError for a missing key or value.
    """
    settings: list[tuple[str, Any]] = []
    for word in words:
        key, equals, text = word.partition("=")
        if not key.strip() or not equals:
            raise wrong_value("--set", word, "a key and a value, such as deeco.publish=0.5")
        try:
            value = loads(f"value = {text}")["value"]
        except (ValueError, KeyError):
            value = text.strip()
        settings.append((key.strip(), value))
    return tuple(settings)


def _number(value: float | str) -> float | str:
    """Parse a number; return any other text unchanged, which decoding rejects."""
    if not isinstance(value, str):
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


def with_models(scenario: Scenario, relocate: Callable[[str], str]) -> Scenario:
    """Return the scenario with `relocate` applied to all names and paths of robot models."""
    robots = replace(scenario.robots, model=relocate(scenario.robots.model))
    tables = tuple(
        robot if robot.model is None else replace(robot, model=relocate(robot.model))
        for robot in scenario.robot
    )
    return replace(scenario, robots=robots, robot=tables)


def module_folders(scenario: Scenario) -> tuple[Path, ...]:
    """Return the folder of a scenario's strategy modules, if it names one."""
    return (Path(scenario.run.modules),) if scenario.run.modules else ()


def map_location(name: str, folder: Path) -> str:
    """Return the absolute path of a map, or the name of a drawn floor. Raises OfficesError."""
    return offices.parse(name).name if offices.is_name(name) else os.path.realpath(folder / name)


def map_conflict(scenario: Scenario, own_map: str, overridden: Collection[tuple[str, ...]]) -> str | None:
    """Return an error if the file's starts or places are for its map `own_map`, which was replaced.

    `overridden`: keys set by the command line.
    """
    robots = any(robot.start is not None or robot.items is not None for robot in scenario.robot)
    task, settings = scenario_task(scenario)
    conflicts: dict[tuple[str, ...], tuple[str, bool]] = {
        ("robots", "start"): ("robots.start=[]", bool(scenario.robots.start)),
        **{
            (scenario.table, key): (f"{scenario.table}.{key}={value}", True)
            for key, value in task.draw_keys(settings, has_areas=False).items()
        },
        ("robot",): ("robot=[]", robots),
    }
    required = [words for key, (words, is_set) in conflicts.items() if is_set and key not in overridden]
    if not required:
        return None
    return (
        f"{scenario.map} replaces the scenario's own map {own_map}, for which its starts or places are"
        f" made; also set {' and '.join(required)}"
    )


def map_title(name: str) -> str:
    """Return the map's short name."""
    return Path(name).name.removesuffix(".yaml")


def is_scenario(path: Path) -> bool:
    """Return whether a file is a scenario; False if it cannot be read."""
    content = readable_tables(path)
    return "map" in content and not is_study(content)


def is_model(path: Path) -> bool:
    """Return whether a file is a robot model; False if it cannot be read."""
    return "footprint" in readable_tables(path)


def readable_tables(path: Path) -> Mapping[str, Any]:
    """Return the tables of a TOML file; none if it cannot be read."""
    try:
        return toml_tables(read_text(path, "TOML"), path)
    except AcrcError:
        return {}


def is_study(content: Mapping[str, Any]) -> bool:
    """Return whether content is that of a study file, which has two keys that scenarios lack."""
    return "strategies" in content and "scenario" in content


def check_exists(path: Path, folder: Path) -> None:
    """Raise AcrcError if a file is missing and a shipped one in `folder` has a similar name."""
    if path.exists():
        return
    shipped = {file.stem: file for file in sorted(folder.glob("*.toml"))}
    for match in difflib.get_close_matches(path.stem, shipped, n=1):
        raise AcrcError(f"{path}: file not found; did you mean {os.path.relpath(shipped[match])}?")


def map_files(described: Path) -> Iterator[Path]:
    """Yield the map's YAML file and its image. Raises MapError for an invalid map."""
    load_map(described)
    yield described
    yield read_header(described).image


def strategy_files(strategy: str, folder: Path) -> Iterator[Path]:
    """Yield the modules of a user strategy in `folder`, with all files of its package.

    Installed strategies yield nothing. Raises AcrcError for a module outside the folder.
    """
    for name in handover.names(strategy):
        module = name.partition(":")[0]
        if is_installed(module):
            continue
        top = module_file(module.partition(".")[0], folder)
        if top is None:
            raise AcrcError(f"{name}: its module is not in {folder}; move it there to bundle it")
        is_package = top.name == "__init__.py" or top.is_dir()
        files = sorted((top if top.is_dir() else top.parent).rglob("*.py")) if is_package else [top]
        for file in files:
            if not file.is_file() or not file.resolve().is_relative_to(folder.resolve()):
                raise AcrcError(f"{file}: is not a file in {folder}; only those are bundled")
        yield from files
