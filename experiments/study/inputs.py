"""What a study reads: its scenario, and the maps, robot models and strategies that this names."""

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from actors.floor import offices
from actors.floor.map_file import load_map
from actors.robot.behaviour import succession
from actors.robot.behaviour.foreign import is_installed
from actors.robot.behaviour.modules import located
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario
from experiments.study.draws import drawn
from experiments.study.study import Study, Trial


class Inputs(NamedTuple):
    """Files, and where they lie relative to one another."""

    scenario: str
    """The study's scenario, one of the files."""
    files: dict[str, Path]
    """Every file by its path in a folder of their own."""


def inputs(study: Study) -> Inputs:
    """Everything that the study's runs read, in folders that stand to one another as they did.

    Raises AcrcError if something is missing, or named so that others could not find it.
    """
    scenario = Path(os.path.realpath(study.scenario))
    if not scenario.is_file():
        raise AcrcError(f"{scenario}: is no file any more, but the campaign's runs have read it")
    told = (
        tomllib.loads(regular_file.content(scenario).decode()),
        [study.settings_of(variant) for variant in study.variants()],
    )
    for text in _texts(told):
        if Path(text).is_absolute():
            raise AcrcError(
                f"{scenario}: names {text}; must be relative to the scenario, so that others find it, too"
            )
    named = list(dict.fromkeys([scenario, *_named(study)]))
    top = Path(os.path.commonpath([path.parent for path in named]))
    files = {path.relative_to(top).as_posix(): path for path in named}
    return Inputs(scenario.relative_to(top).as_posix(), dict(sorted(files.items())))


def _texts(told: Any) -> Iterator[str]:
    """Every text in nested tables and lists."""
    if isinstance(told, str):
        yield told
    elif isinstance(told, dict):
        yield from _texts(list(told.values()))
    elif isinstance(told, list | tuple):
        for one in told:
            yield from _texts(one)


def _named(study: Study) -> Iterator[Path]:
    for variant in study.variants():
        for strategy in study.strategies:
            draws = drawn(study, Trial(strategy, study.first_seed, variant))
            own = (*study.settings_of(variant), *draws.items())
            overrides = Overrides(strategy=strategy, settings=own)
            for path in _files(load_scenario(Path(study.scenario), overrides), strategy):
                yield Path(os.path.realpath(path))


def _files(scenario: Scenario, strategy: str) -> Iterator[Path]:
    """Of a map file also the image; of a strategy of one's own its module, or all of its package."""
    load_map(scenario.map)  # what is no map does not travel under its name
    if not offices.is_name(scenario.map):  # a drawn floor is its name
        described = Path(scenario.map)
        yield described
        yield described.parent / yaml.safe_load(regular_file.content(described))["image"]
    for model in (scenario.robots.model, *(robot.model for robot in scenario.robot)):
        if model is not None and model.endswith(".toml"):
            yield Path(model)
    if ":" in strategy and scenario.run.modules:
        yield from _modules(strategy, Path(scenario.run.modules))


def _modules(strategy: str, folder: Path) -> Iterator[Path]:
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
