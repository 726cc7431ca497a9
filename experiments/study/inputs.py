"""What a study reads: its scenario, and the maps, robot models and strategies that this names."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from actors import toml_file
from actors.floor import offices
from actors.floor.map_file import load_map
from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, load_scenario, map_files, strategy_files
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
        toml_file.tables(toml_file.read(scenario, "scenario"), scenario),
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
    if offices.is_name(scenario.map):
        load_map(scenario.map)  # a drawn floor is its name: what is none does not travel
    else:
        yield from map_files(Path(scenario.map))
    for model in (scenario.robots.model, *(robot.model for robot in scenario.robot)):
        if model is not None and model.endswith(".toml"):
            yield Path(model)
    if ":" in strategy and scenario.run.modules:
        yield from strategy_files(strategy, Path(scenario.run.modules))
