"""Settings of a study's trials: command-line options and random draws by seed."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace
from numpy.random import Generator

from acrc_testbed.experiments.metrics import MetricError, load_function
from acrc_testbed.experiments.study import Study, Trial, Variant, load_study, task_declaration
from acrc_testbed.experiments.trial_record import CodeFolders
from actors.floor.doors import Doorways
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.geometry import Point
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError, wrong_value
from actors.randomness import generator
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.robot_model import OdometryKind, load_model
from actors.runtime.errors import AcrcError
from actors.settings import plain
from actors.task.loading import task_setup
from actors.user_code import set_folders
from cleaning.strategies import entry
from deploy.scenario.events import item_area_tables, scenario_task
from deploy.scenario.scenario_file import (
    Overrides,
    is_scenario,
    load_scenario,
    module_folders,
    parse_settings,
)
from deploy.scenario.tables import Scenario

SHADOWING_DB: Final = 6.0
"""Gives a grey zone like that of measured links; see docs/radio.md, "Shadowing"."""


def condition_settings(load: Callable[[Variant], Scenario], own: Variant) -> dict[str, Any]:
    """Return settings that make each seed draw what the scenario fixes, in the form of `acrc run --set`.

    `load`: loads the scenario with settings; `own`: settings of the study, which are kept, like tables
    [[robot]] and listed items.
    """
    # on another map a scenario can be loaded only once its starts and items are drawn
    scenario = load(tuple(pair for pair in own if pair[0] != "map"))
    drawn: dict[str, Any] = {}
    if scenario.robots.start:
        drawn["robots.start"] = []
    drawn |= _drawn_items(scenario)
    if _odometry_kind(scenario) == "exact":
        drawn["robots.odometry"] = _odometry_with_errors(scenario)
    if not scenario.radio.shadowing_db:
        drawn["radio.shadowing_db"] = SHADOWING_DB
    # a key is set by itself or by a table that contains it
    settings = {
        key: value
        for key, value in drawn.items()
        if not any(f"{key}.".startswith(f"{name}.") for name, _ in own)
    }
    if settings.keys() & _drawn_items(scenario):
        redrawn = _drawn_items(scenario, has_areas=bool(load((*own, *settings.items())).area))
        settings |= {key: value for key, value in redrawn.items() if key in settings}
    return settings


def _drawn_items(scenario: Scenario, *, has_areas: bool = False) -> dict[str, Any]:
    """Return settings that draw the items that the task's table fixes."""
    task, settings = scenario_task(scenario)
    keys = task.draw_keys(settings, has_areas=has_areas)
    return {f"{scenario.table}.{key}": value for key, value in keys.items()}


def common_conditions(scenario: Scenario) -> str | None:
    """Return a sentence on conditions that are equal for all seeds; None if all starts are drawn."""
    own = {robot.id for robot in scenario.robot if robot.start is not None}
    fixed_starts = own | set(scenario.ids[: len(scenario.robots.start)])
    starts = sum(name in fixed_starts for name in scenario.ids)
    if not starts:
        return None
    subject = (
        "all robots start" if starts == len(scenario.ids) else f"{starts} of {len(scenario.ids)} robots start"
    )
    fixed = [f"{subject} at the same positions"]
    listed = {robot.id for robot in scenario.robot if robot.items is not None}
    if _drawn_items(scenario) or listed >= {*scenario.ids}:
        fixed.append(f"the {scenario.table} are the same")
    if _odometry_kind(scenario) == "exact":
        fixed.append("odometry is exact")
    if not scenario.radio.shadowing_db:
        fixed.append("the radio has no shadowing")
    return (
        f"For every seed, {', '.join(fixed)}, as fixed in the scenario"
        '; to draw them for each seed, write a study with conditions = "drawn" (docs/experiments.md)'
    )


def _odometry_kind(scenario: Scenario) -> OdometryKind:
    return scenario.robots.odometry or load_model(scenario.robots.model, None).odometry


def _odometry_with_errors(scenario: Scenario) -> OdometryKind:
    """Return the model's odometry errors; if exact, a Kobuki's for two wheels and Stage's for others."""
    model = load_model(scenario.robots.model, None)
    if model.odometry != "exact":
        return model.odometry
    return "kobuki" if model.drive.kind == "differential" else "stage"


_STEP_S: Final = 0.1
Event = dict[str, Any]


def draw_settings(study: Study, trial: Trial) -> dict[str, Any]:
    """Draw the settings of a trial, in the form of `acrc run --set`; empty if the study draws nothing.

    Raises AcrcError if the scenario has no room for something.
    """
    own = study.settings_of(trial.variant)
    settings: dict[str, Any] = {}
    if study.conditions == "drawn":
        settings |= condition_settings(lambda keys: _scenario(study, trial, keys), own)
    if not study.distributions:
        return settings
    scenario = _scenario(study, trial, (*own, *settings.items()))
    events: list[Event] = []
    for number, distribution in enumerate(study.distributions):
        rng = generator(trial.seed, f"vary {distribution.kind}", str(number))
        drawn = _KINDS[distribution.kind](_Sampler(rng, dict(distribution.parameters), scenario))
        if isinstance(drawn, dict):
            settings |= drawn
        else:
            events += drawn
    if events:
        own_events = (
            {scenario.table if key == "items" else key: value for key, value in plain(event).items()}
            for event in scenario.event
        )
        settings["event"] = [*own_events, *events]
    return settings


def _scenario(study: Study, trial: Trial, own: Variant) -> Scenario:
    return load_scenario(Path(study.scenario), Overrides(seed=trial.seed, settings=own))


class _Sampler(NamedTuple):
    """Random draws from one distribution of a study for one seed."""

    rng: Generator
    parameters: dict[str, Any]
    """Parameters; each a value or a range."""
    scenario: Scenario

    def draw_number(self, name: str, digits: int) -> float:
        """Draw uniformly from the parameter's range, and round."""
        return round(self._draw(name), digits)

    def draw_count(self) -> int:
        """Draw a whole number from the range of "count", both ends included."""
        low, high = self.parameters["count"]
        return int(self.rng.integers(int(low), int(high), endpoint=True))

    def draw_instant(self, name: str) -> float:
        """Draw the boundary of a step, s."""
        return round(round(self._draw(name) / _STEP_S) * _STEP_S, 1)

    def _draw(self, name: str) -> float:
        low, high = self.parameters[name]
        return float(low + (high - low) * self.rng.random())

    def draw_indices(self, sequence: Sequence[Any]) -> list[int]:
        """Draw "count" indices of a sequence, or all if these are fewer."""
        size = min(self.draw_count(), len(sequence))
        return list(map(int, self.rng.choice(len(sequence), size=size, replace=False)))

    @property
    def radius(self) -> float:
        """Circumradius of the robots, m."""
        return load_model(self.scenario.robots.model, None).footprint.circumradius


def _kills(sampler: _Sampler) -> list[Event]:
    """Draw kills among robots without events in the scenario."""
    verbs = ("kill", "freeze", "restart")
    named = {getattr(event, verb) for event in sampler.scenario.event for verb in verbs}
    robots = [robot for robot in sampler.scenario.ids if robot not in named]
    return [
        {"at": sampler.draw_instant("at"), "kill": robots[index]} for index in sampler.draw_indices(robots)
    ]


def _jams(sampler: _Sampler) -> list[Event]:
    points = draw_points(load_map(sampler.scenario.map), sampler.draw_count(), rng=sampler.rng)
    return [
        {
            "at": sampler.draw_instant("at"),
            "jam": [round(point.x, 2), round(point.y, 2)],
            "radius": sampler.draw_number("radius", 2),
            "duration": sampler.draw_number("duration", 1),
        }
        for point in points
    ]


def _doors(sampler: _Sampler) -> list[Event]:
    points = sampler.parameters["points"]
    return [
        {"at": 0.0, "obstacle": [*map(float, points[index])], "radius": sampler.draw_number("radius", 2)}
        for index in sorted(sampler.draw_indices(points))
    ]


def _closures(sampler: _Sampler) -> list[Event]:
    """Draw closures among doors without events in the scenario; a door may stay closed until the end."""
    scenario = sampler.scenario
    doorways = Doorways(load_map(scenario.map), sampler.radius)
    points = [event.close for event in scenario.event if event.close is not None]
    taken = {doorways.at(Point(*point)).index for point in points}
    doors = [door for door in doorways.regions.doors if door.index not in taken]
    events: list[Event] = []
    for index in sorted(sampler.draw_indices(doors)):
        point = [round(doors[index].middle.x, 2), round(doors[index].middle.y, 2)]
        closes = sampler.draw_instant("at")
        opens = round(closes + max(sampler.draw_instant("duration"), _STEP_S), 1)
        events.append({"at": closes, "close": point})
        if opens < scenario.run.duration:
            events.append({"at": opens, "open": point})
    return events


def _tasks(sampler: _Sampler) -> list[Event]:
    scenario = sampler.scenario
    points = draw_points(
        load_map(scenario.map),
        sampler.draw_count(),
        rng=sampler.rng,
        passage=sampler.radius,
        areas=[table.area for table in item_area_tables(scenario)] or None,
    )
    return [
        {
            "at": sampler.draw_instant("at"),
            "give": scenario.ids[int(sampler.rng.integers(len(scenario.ids)))],
            scenario.table: [[round(point.x, 3), round(point.y, 3)]],
        }
        for point in points
    ]


def _dropout(sampler: _Sampler) -> dict[str, Any]:
    return {"uncertainty.dropout": sampler.draw_number("share", 4)}


def _odometry(sampler: _Sampler) -> dict[str, Any]:
    drift = {"uncertainty.drift": sampler.draw_number("drift", 3)}
    return drift | ({"robots.odometry": "kobuki"} if sampler.scenario.robots.odometry == "exact" else {})


_KINDS: Final[Mapping[str, Callable[[_Sampler], list[Event] | dict[str, Any]]]] = {
    "kills": _kills,
    "jams": _jams,
    "doors": _doors,
    "closures": _closures,
    "tasks": _tasks,
    "dropout": _dropout,
    "odometry": _odometry,
}
"""Functions that draw events or settings, by kind of distribution."""


_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"
_STRATEGIES: Final = "none,chapter"
PRESETS: Final = {"chapter": SHIPPED / "studies" / "chapter.toml"}
"""Shipped studies by name."""


@dataclass(frozen=True)
class StudyOptions:
    """Command-line options that define or change a study."""

    study: Path | None = None
    preset: str | None = None
    scenario: Path | None = None
    strategies: str | None = None
    seeds: int | None = None
    robots: str | None = None
    duration: str | None = None
    settings: tuple[str, ...] = ()
    tuning: bool = False
    isolate: bool = False


def resolve_study(options: StudyOptions) -> tuple[StudyOptions, tuple[str, ...]]:
    """Return the options, with a scenario given as STUDY moved to --scenario, and a note on that."""
    if options.study is None or options.scenario is not None or not is_scenario(options.study):
        return options, ()
    if options.preset is not None:
        raise OptionError(f"--preset: is a study; cannot be combined with {options.study}")
    taken = dataclasses.replace(options, study=None, scenario=options.study)
    study = make_study(taken)
    names, first = " and ".join(study.strategies), study.first_seed
    others = "" if options.strategies else "; use --strategies NAME,NAME to compare others"
    seeds = f"seeds {first} to {first + study.seeds - 1}" if study.seeds > 1 else f"seed {first}"
    return taken, (f"{options.study} is a scenario: comparing {names}, each with {seeds}{others}",)


def make_study(options: StudyOptions) -> Study:
    """Return the study of a file with command-line options applied, or a study of options alone."""
    own: list[tuple[str, Any]] = list(parse_settings(options.settings))
    for key, text in (("robots.count", options.robots), ("run.duration", options.duration)):
        if text is not None:
            own += parse_settings((f"{key}={text}",))
    path = study_path(options)
    if path is not None:
        study = load_study(path, tuning=options.tuning)
    else:
        scenario = options.scenario or _SCENARIO
        task = task_declaration(scenario, tuple(own))
        names = _STRATEGIES if task.baseline in _STRATEGIES else task.baseline
        named = (name for name in (options.strategies or names).split(",") if name)
        study = Study(
            name=scenario.stem,
            task=task,
            scenario=str(scenario.resolve()),
            strategies=tuple(dict.fromkeys(named)),
            seeds=10,
            tuning=options.tuning,
        )
    settings = (*study.settings, *own)
    return msgspec.structs.replace(
        study,
        task=task_declaration(Path(study.scenario), settings),
        settings=settings,
        seeds=options.seeds or study.seeds,
        isolated=study.isolated or options.isolate,
    )


def study_path(options: StudyOptions) -> Path | None:
    """Return the path of the study file; None: the study has no file."""
    path = options.study
    if options.preset is not None:
        if options.preset not in PRESETS:
            raise wrong_value("--preset", options.preset, f"one of {', '.join(PRESETS)}")
        if path is not None:
            raise OptionError("--preset: is a study; cannot be combined with a STUDY.toml")
        path = PRESETS[options.preset]
    if path is not None and (options.scenario is not None or options.strategies is not None):
        raise OptionError(
            "--scenario and --strategies: defined by the study; cannot be combined with a study or --preset"
        )
    return path


def check_study(study: Study, permit: Permit, source: Path | None) -> tuple[list[str], CodeFolders]:
    """Check scenario, task, keys, strategies, metrics and draws of every variant before the first trial.

    Imports the functions of metrics. Returns warnings on equal starts, and the folders of user code.
    `source`: study file; None: strategies of the command line. Raises as `permitted_folders`.
    """
    warnings, modules = dict[str, None](), dict[Path, None]()
    file = source or Path(study.scenario)
    for trial in study.trials_of(study.first_seed):
        own = (*study.settings_of(trial.variant), *draw_settings(study, trial).items())
        overrides = Overrides(seed=trial.seed, strategy=trial.strategy, settings=own)
        scenario = load_scenario(Path(study.scenario), overrides)
        if (other := task_setup(scenario.task.use, {}).declaration) != study.task:
            raise AcrcError(
                f"{file}: a variant has the task {other.name}, another one {study.task.name}; different "
                "tasks cannot be compared: use a study for each"
            )
        named = entry(trial.strategy)
        own_permit = permit if source is not None else replace(permit, typed=named)
        folders = permitted_folders(file, named, module_folders(scenario), own_permit)
        modules |= dict.fromkeys(folders)
        if alike := common_conditions(scenario):
            warnings[alike] = None
    return list(warnings), CodeFolders(tuple(modules), _metric_folders(study, permit, file), permit.modules)


def _metric_folders(study: Study, permit: Permit, file: Path) -> tuple[Path, ...]:
    """Return the folders of the functions of a study's metrics, after importing them. Raises AcrcError."""
    found = [
        permitted_folders(file, one.use, [Path(study.modules)], permit, "metric") for one in study.metric
    ]
    folders = tuple(dict.fromkeys(itertools.chain.from_iterable(found)))
    if study.metric:
        set_folders(folders)
    for one in study.metric:
        try:
            load_function(one.use)
        except MetricError as error:
            raise AcrcError(f"{file}: metric {one.name}: {error}") from None
    return folders
