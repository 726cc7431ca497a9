"""The study that a command line means, and whatever every trial of it would stumble over."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec

from acrc_testbed.experiments.study.draws import drawn, same_for_all_seeds
from acrc_testbed.experiments.study.study import Study, load_study
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError, wrong_value
from actors.robot.behaviour.foreign import Permit, admitted
from cleaning.place import GOLDEN
from cleaning.strategies import entry
from deploy.scenario.scenario_file import Overrides, is_scenario, load_scenario, module_folders, settings
from deploy.scenario.tables import Scenario

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
class StudyWishes:
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


def understood(wishes: StudyWishes) -> tuple[StudyWishes, tuple[str, ...]]:
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


def study_of(wishes: StudyWishes) -> Study:
    """The study in the file, or the one that the command line describes, with its wishes laid over."""
    study = _plain(wishes)
    return msgspec.structs.replace(study, isolated=True) if wishes.isolate else study


def _plain(wishes: StudyWishes) -> Study:
    own: list[tuple[str, Any]] = list(settings(wishes.settings))
    for key, text in (("robots.count", wishes.robots), ("run.duration", wishes.duration)):
        if text is not None:
            own += settings((f"{key}={text}",))
    path = path_of(wishes)
    if path is not None:
        study = load_study(path, tuning=wishes.tuning)
        return msgspec.structs.replace(
            study, settings=(*study.settings, *own), seeds=wishes.seeds or study.seeds
        )
    scenario = wishes.scenario or _SCENARIO
    named = tuple(name for name in (wishes.strategies or ",".join(_STRATEGIES)).split(",") if name)
    return Study(
        name=scenario.stem,
        scenario=str(scenario.resolve()),
        strategies=tuple(dict.fromkeys(named)),
        seeds=wishes.seeds or 10,
        tuning=wishes.tuning,
        settings=tuple(own),
    )


def path_of(wishes: StudyWishes) -> Path | None:
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
    strategies. Raises as `actors.robot.behaviour.foreign.admitted` does.
    """
    said, modules = dict[str, None](), dict[Path, None]()
    for trial in study.trials_of(study.first_seed):
        own = (*study.settings_of(trial.variant), *drawn(study, trial).items())
        overrides = Overrides(seed=trial.seed, strategy=trial.strategy, settings=own)
        scenario = load_scenario(Path(study.scenario), overrides)
        named = entry(trial.strategy)
        own_permit = permit if source is not None else replace(permit, typed=named)
        folders = admitted(source or Path(study.scenario), named, module_folders(scenario), own_permit)
        modules |= dict.fromkeys(folders)
        alike = same_for_all_seeds(scenario)
        said |= dict.fromkeys(close_places(scenario)) | ({alike: None} if alike else {})
    return list(said), tuple(modules)
