"""The scenario that lies beside a result: it runs again from wherever the folder is taken.

Its map and its robot models lie in the folder, too. A strategy of one's own does not: `run.modules` says
where it lay, seen from the folder, for whoever looks for it; nothing else in the file leads out of it.
"""

import os
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.version import software
from deploy.run.options import RunOptions
from deploy.scenario.resolve import ResolvedScenario
from deploy.scenario.stack_tables import presets_of
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import to_toml
from observation.results.result import UNKNOWN, Origin, versions

MAP: Final = "map"
"""Folder of the map, in the run's folder."""
_MODELS: Final = "models"


class ScenarioCopy(NamedTuple):
    """What is written beside a result."""

    text: str
    """Of `scenario.toml`."""
    models: tuple[tuple[Path, str], ...]
    """Robot models, and where the text has them: a path in the run's folder."""
    origin: Origin = UNKNOWN
    """What the result says about where it comes from."""


def copied_scenario(settled: ResolvedScenario, options: RunOptions) -> ScenarioCopy:
    """The copy for the run's folder, in MAP of which the map will lie; paths of the scenario are absolute."""
    scenario, out = settled.scenario, options.out
    named = dict.fromkeys((scenario.robots.model, *(robot.model for robot in scenario.robot)))
    files = [name for name in named if name is not None and name.endswith(".toml")]
    places = {name: f"{_MODELS}/{number}-{Path(name).name}" for number, name in enumerate(files, start=1)}

    def moved(model: str | None) -> str | None:
        return model if model is None else places.get(model, model)

    lay = options.modules[0] if options.modules else scenario.run.modules
    modules = os.path.relpath(lay, out) if ":" in scenario.run.strategy and lay else None
    here = scenario.model_copy(
        update={
            "map": f"{MAP}/map.yaml",
            "run": scenario.run.model_copy(update={"modules": modules}),
            "robots": scenario.robots.model_copy(update={"model": moved(scenario.robots.model)}),
            "robot": tuple(
                robot.model_copy(update={"model": moved(robot.model)}) for robot in scenario.robot
            ),
        }
    )
    models = tuple((Path(name), place) for name, place in places.items())
    return ScenarioCopy(
        to_toml(here), models, origin(scenario, options.scenario, settled.behaviour, software())
    )


def origin(scenario: Scenario, name: str, behaviour: str, commit: str) -> Origin:
    """The origin of a run of `scenario`, whose file is called `name`."""
    run, presets = scenario.run, presets_of(scenario)
    return Origin(
        name,
        run.strategy,
        behaviour,
        dict(scenario.strategy),
        commit,
        versions(),
        key=run.key or "",
        navigation=presets["navigation"],
        localisation=presets["localisation"],
    )
