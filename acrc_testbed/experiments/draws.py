"""Settings of a study's trials: from options of a command line, and drawn for each seed; all are checked."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from numpy.random import Generator

from acrc_testbed.experiments.study import Study, Trial, Variant, load_study
from actors.floor.doors import Doorways
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.geometry import Point
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError, wrong_value
from actors.randomness import generator
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.robot_model import OdometryKind, load_model
from actors.settings import plain
from cleaning.place import GOLDEN
from cleaning.strategies import entry
from deploy.scenario.events import place_areas
from deploy.scenario.scenario_file import (
    Overrides,
    is_scenario,
    load_scenario,
    module_folders,
    parse_settings,
)
from deploy.scenario.tables import Scenario

SHADOWING_DB: Final = 6.0
"""Makes a grey zone like that of measured links, from 70 % of frames upward: docs/radio.md, "Shadowing"."""


def drawn_conditions(load: Callable[[Variant], Scenario], own: Variant) -> dict[str, Any]:
    """Settings with which each seed draws what the scenario has fixed, as `acrc run --set` takes them.

    `load`: the scenario with such settings; `own`: what the study sets or varies, which stays as it is, as do
    tables [[robot]] and places that are listed there.
    """
    # on another map a scenario can be loaded only once its starts and places are drawn
    scenario = load(tuple(pair for pair in own if pair[0] != "map"))
    found: dict[str, Any] = {}
    if scenario.robots.start:
        found["robots.start"] = []
    if scenario.places.preset == "golden":
        found["places.preset"] = "free"
    if _odometry_kind(scenario) == "exact":
        found["robots.odometry"] = _drifting(scenario)
    if not scenario.radio.shadowing_db:
        found["radio.shadowing_db"] = SHADOWING_DB
    settings = {key: value for key, value in found.items() if not any(_covers(one, key) for one, _ in own)}
    if "places.preset" in settings and load((*own, *settings.items())).area:
        settings["places.preset"] = "areas"
    return settings


def same_for_all_seeds(scenario: Scenario) -> str | None:
    """A sentence on what every seed of this scenario has in common; None if all starts are drawn."""
    own = {robot.id for robot in scenario.robot if robot.start is not None}
    given = own | set(scenario.ids[: len(scenario.robots.start)])
    starts = sum(name in given for name in scenario.ids)
    if not starts:
        return None
    who = (
        "all robots begin" if starts == len(scenario.ids) else f"{starts} of {len(scenario.ids)} robots begin"
    )
    more = [
        word
        for word, is_so in (
            ("the places are the same", scenario.places.preset in {"golden", "listed"}),
            ("odometry is exact", _odometry_kind(scenario) == "exact"),
            ("radio has no shadowing", not scenario.radio.shadowing_db),
        )
        if is_so
    ]
    return (
        f"with every seed {', '.join((f'{who} in the same positions', *more))}, as the scenario is written; "
        'a study with conditions = "drawn" draws them'
    )


def _covers(named: str, key: str) -> bool:
    """A key, or the table around it."""
    return key == named or key.startswith(named + ".")


def _odometry_kind(scenario: Scenario) -> OdometryKind:
    return scenario.robots.odometry or load_model(scenario.robots.model, None).odometry


def _drifting(scenario: Scenario) -> OdometryKind:
    """That of the robots' model; where it has none, a Kobuki's for two wheels, and Stage's for others."""
    model = load_model(scenario.robots.model, None)
    if model.odometry != "exact":
        return model.odometry
    return "kobuki" if model.drive.kind == "differential" else "stage"


_STEP_S: Final = 0.1
Event = dict[str, Any]


def drawn(study: Study, trial: Trial) -> dict[str, Any]:
    """The trial's own settings, as `acrc run --set` takes them; none if the study draws nothing.

    Raises AcrcError where the scenario has no room for something.
    """
    own = study.settings_of(trial.variant)
    settings: dict[str, Any] = {}
    if study.conditions == "drawn":
        settings |= drawn_conditions(lambda some: _scenario(study, trial, some), own)
    if not study.distributions:
        return settings
    scenario = _scenario(study, trial, (*own, *settings.items()))
    events: list[Event] = []
    for number, one in enumerate(study.distributions):
        rng = generator(trial.seed, f"vary {one.kind}", str(number))
        found = _KINDS[one.kind](_Draw(rng, dict(one.parameters), scenario))
        if isinstance(found, dict):
            settings |= found
        else:
            events += found
    if events:
        settings["event"] = [*map(plain, scenario.event), *events]
    return settings


def _scenario(study: Study, trial: Trial, own: Variant) -> Scenario:
    return load_scenario(Path(study.scenario), Overrides(seed=trial.seed, settings=own))


class _Draw(NamedTuple):
    """One distribution of a study, drawn for one seed."""

    rng: Generator
    given: dict[str, Any]
    """Range of each parameter."""
    scenario: Scenario

    def number(self, name: str, digits: int) -> float:
        """Draw uniformly from the parameter's range, and round."""
        low, high = self.given[name]
        return round(float(low + (high - low) * self.rng.random()), digits)

    def whole(self) -> int:
        """Draw a whole number from the range of "count", both ends included."""
        low, high = self.given["count"]
        return int(self.rng.integers(int(low), int(high), endpoint=True))

    def instant(self, name: str) -> float:
        """Draw the boundary of a step, s."""
        low, high = self.given[name]
        return round(round(float(low + (high - low) * self.rng.random()) / _STEP_S) * _STEP_S, 1)

    def some(self, of: Sequence[Any]) -> list[int]:
        """Draw "count" indices of a sequence, or all if these are fewer."""
        size = min(self.whole(), len(of))
        return list(map(int, self.rng.choice(len(of), size=size, replace=False)))

    @property
    def radius(self) -> float:
        """Of the robots' bodies, m."""
        return load_model(self.scenario.robots.model, None).footprint.circumradius


def _kills(draw: _Draw) -> list[Event]:
    """Robots that the scenario's own events do not mention."""
    verbs = ("kill", "freeze", "restart")
    named = {getattr(event, verb) for event in draw.scenario.event for verb in verbs}
    robots = [robot for robot in draw.scenario.ids if robot not in named]
    return [{"at": draw.instant("at"), "kill": robots[index]} for index in draw.some(robots)]


def _jams(draw: _Draw) -> list[Event]:
    points = draw_points(load_map(draw.scenario.map), draw.whole(), rng=draw.rng)
    return [
        {
            "at": draw.instant("at"),
            "jam": [round(point.x, 2), round(point.y, 2)],
            "radius": draw.number("radius", 2),
            "duration": draw.number("duration", 1),
        }
        for point in points
    ]


def _doors(draw: _Draw) -> list[Event]:
    points = draw.given["points"]
    return [
        {"at": 0.0, "obstacle": [*map(float, points[index])], "radius": draw.number("radius", 2)}
        for index in sorted(draw.some(points))
    ]


def _closures(draw: _Draw) -> list[Event]:
    """Doors that the scenario's own events leave alone; one that would open after the end stays closed."""
    scenario = draw.scenario
    doorways = Doorways(load_map(scenario.map), draw.radius)
    points = [event.close for event in scenario.event if event.close is not None]
    taken = {doorways.at(Point(*point)).index for point in points}
    doors = [door for door in doorways.regions.doors if door.index not in taken]
    events: list[Event] = []
    for index in sorted(draw.some(doors)):
        point = [round(doors[index].middle.x, 2), round(doors[index].middle.y, 2)]
        closes = draw.instant("at")
        opens = round(closes + max(draw.instant("duration"), _STEP_S), 1)
        events.append({"at": closes, "close": point})
        if opens < scenario.run.duration:
            events.append({"at": opens, "open": point})
    return events


def _tasks(draw: _Draw) -> list[Event]:
    scenario = draw.scenario
    points = draw_points(
        load_map(scenario.map), draw.whole(), rng=draw.rng, passage=draw.radius, areas=place_areas(scenario)
    )
    return [
        {
            "at": draw.instant("at"),
            "give": scenario.ids[int(draw.rng.integers(len(scenario.ids)))],
            "places": [[round(point.x, 3), round(point.y, 3)]],
        }
        for point in points
    ]


def _dropout(draw: _Draw) -> dict[str, Any]:
    return {"uncertainty.dropout": draw.number("share", 4)}


def _odometry(draw: _Draw) -> dict[str, Any]:
    drift = {"uncertainty.drift": draw.number("drift", 3)}
    return drift | ({"robots.odometry": "kobuki"} if draw.scenario.robots.odometry == "exact" else {})


_KINDS: Final[Mapping[str, Callable[[_Draw], list[Event] | dict[str, Any]]]] = {
    "kills": _kills,
    "jams": _jams,
    "doors": _doors,
    "closures": _closures,
    "tasks": _tasks,
    "dropout": _dropout,
    "odometry": _odometry,
}
"""Events or settings of each kind of distribution."""


_WEDGED: Final = 0.45
"""Robots nearer to one another than this, m, have no valid trajectory and stay where they are."""


def close_places(scenario: Scenario) -> Iterator[str]:
    """A sentence for each robot that ends so near another robot's place that it stands in the way there.

    Only of the golden places, which are the same for every seed.
    """
    if scenario.places.preset != "golden":
        return
    count = scenario.places.per_robot
    lists = [points[:count] for points in GOLDEN[: scenario.robots.count]]
    for robot, points in enumerate(lists):
        for other, theirs in enumerate(lists):
            if other == robot or not points:
                continue
            for number, place in enumerate(theirs):
                apart = points[-1].distance_to(place)
                if apart < _WEDGED:
                    yield (
                        f"the golden places: r{robot + 1} ends {apart:.2f} m from place {number}"
                        f" of r{other + 1}; if it gets there first, that one may stay undone"
                    )


_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"
_STRATEGIES: Final = ("none", "chapter")
PRESETS: Final = {"chapter": SHIPPED / "studies" / "chapter.toml"}
"""Studies that are shipped."""


@dataclass(frozen=True)
class StudyOptions:
    """The command line's own words about the study."""

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


def understood(wishes: StudyOptions) -> tuple[StudyOptions, tuple[str, ...]]:
    """The wishes, a scenario where a study is wanted taken for --scenario, and what is said of that."""
    if wishes.study is None or wishes.scenario is not None or not is_scenario(wishes.study):
        return wishes, ()
    if wishes.preset is not None:
        raise OptionError(f"--preset: is a study by itself; cannot be combined with {wishes.study}")
    taken = replace(wishes, study=None, scenario=wishes.study)
    study = study_of(taken)
    names, first = " and ".join(study.strategies), study.first_seed
    others = "" if wishes.strategies else "; --strategies NAME,NAME compares others"
    seeds = f"seeds {first} to {first + study.seeds - 1}" if study.seeds > 1 else f"seed {first}"
    return taken, (f"{wishes.study} is a scenario: it runs with {names}, each with {seeds}{others}",)


def study_of(wishes: StudyOptions) -> Study:
    """Return the study in the file with the options of the command line, or the study of these alone."""
    own: list[tuple[str, Any]] = list(parse_settings(wishes.settings))
    for key, text in (("robots.count", wishes.robots), ("run.duration", wishes.duration)):
        if text is not None:
            own += parse_settings((f"{key}={text}",))
    path = path_of(wishes)
    if path is not None:
        study = load_study(path, tuning=wishes.tuning)
    else:
        scenario = wishes.scenario or _SCENARIO
        named = (name for name in (wishes.strategies or ",".join(_STRATEGIES)).split(",") if name)
        study = Study(
            name=scenario.stem,
            scenario=str(scenario.resolve()),
            strategies=tuple(dict.fromkeys(named)),
            seeds=10,
            tuning=wishes.tuning,
        )
    return msgspec.structs.replace(
        study,
        settings=(*study.settings, *own),
        seeds=wishes.seeds or study.seeds,
        isolated=study.isolated or wishes.isolate,
    )


def path_of(wishes: StudyOptions) -> Path | None:
    """Of the study's file; None: there is none."""
    if wishes.preset is not None and wishes.preset not in PRESETS:
        raise wrong_value("--preset", wishes.preset, f"one of {', '.join(PRESETS)}")
    if wishes.preset is not None and wishes.study is not None:
        raise OptionError("--preset: is a study by itself; cannot be combined with a STUDY.toml")
    path = PRESETS[wishes.preset] if wishes.preset is not None else wishes.study
    if path is not None and (wishes.scenario is not None or wishes.strategies is not None):
        raise OptionError(
            "--scenario and --strategies: the study says so; cannot be combined with a STUDY.toml or --preset"
        )
    return path


def check(study: Study, permit: Permit, source: Path | None) -> tuple[list[str], tuple[Path, ...]]:
    """Say whatever every trial would stumble over before the first: scenario, keys, strategies, draws.

    Gives what a person should know about places and starts, a sentence each, and the folders in which
    strategies are to be looked for. `source`: the study's file; None: the command line itself names the
    strategies. Raises as `actors.robot.behaviour.code_permit.permitted_folders` does.
    """
    said, modules = dict[str, None](), dict[Path, None]()
    for trial in study.trials_of(study.first_seed):
        own = (*study.settings_of(trial.variant), *drawn(study, trial).items())
        overrides = Overrides(seed=trial.seed, strategy=trial.strategy, settings=own)
        scenario = load_scenario(Path(study.scenario), overrides)
        named = entry(trial.strategy)
        own_permit = permit if source is not None else replace(permit, typed=named)
        folders = permitted_folders(
            source or Path(study.scenario), named, module_folders(scenario), own_permit
        )
        modules |= dict.fromkeys(folders)
        alike = same_for_all_seeds(scenario)
        said |= dict.fromkeys(close_places(scenario)) | ({alike: None} if alike else {})
    return list(said), tuple(modules)
