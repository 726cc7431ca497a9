"""What a branch does to the strategy: whether its settings are other ones at all, and what they are beside.

Another value of a setting means a behaviour that is made anew, which forgets what the one before kept for
itself. So a branch with a changed value is not compared with its run alone, but with its control: the same
strategy made anew at the same instant, with the values that it had.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from actors.installation.usage import wrong_value
from actors.robot.behaviour import Setting, succession
from actors.robot.behaviour.succession import Turn
from cleaning.settings import MadeSettings, made_meanwhile
from cleaning.strategies import entry
from deploy.branches.change import Change
from deploy.run.preflight import preflight_here
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario

_STRATEGY: Final = "strategy."


def strategy_settings(given: Iterable[tuple[str, Any]], file: Path) -> Mapping[str, Setting]:
    """The strategy's settings that a command line sets, by name.

    Every other key must have the value that the run had, as its scenario in `file` says.
    Raises OptionError, and AcrcError for what no scenario can hold.
    """
    found: dict[str, Setting] = {}
    for key, value in given:
        if key.startswith(_STRATEGY) and key != _STRATEGY:
            found[key.removeprefix(_STRATEGY)] = value
        elif _told(load_scenario(file, Overrides(settings=((key, value),)))) != _told(load_scenario(file)):
            raise wrong_value(
                "--set",
                key,
                "strategy.NAME with --from, or the value that the run had; with another one it is no branch",
            )
    return found


def _told(scenario: Scenario) -> tuple[object, ...]:
    """All that the actors of a run are told of it."""
    settled = resolve(scenario)
    return settled.world, settled.radio, settled.behaviour, settled.adaptation, settled.stack


def changed(scenario: Scenario, change: Change) -> Scenario:
    """The scenario beside the branch: with the other strategy, or other settings, from the instant on."""
    present = _present(scenario, change)
    settings = change.settings if change.strategy else {**present.settings, **change.settings}
    return _from(scenario, Turn(change.at_s, change.strategy or present.name, settings))


def control(scenario: Scenario, change: Change) -> Scenario | None:
    """The scenario with the strategy made anew there, with its own values; None if another one takes over."""
    present = _present(scenario, change)
    if change.strategy is not None and entry(change.strategy) != entry(present.name):
        return None
    return _from(scenario, Turn(change.at_s, present.name, present.settings))


def same(branch: Scenario, beside: Scenario, modules: Sequence[Path]) -> bool:
    """True if all strategies have the same values in both, whichever of them are said and how.

    That is what `from_settings` makes of them. Of a strategy that reads a setting by itself the values must
    be the same as they stand there. The strategies' code runs, from `modules` if it is not installed.
    """
    given = [[turn.settings for turn in succession.split(one.run.strategy)[1]] for one in (branch, beside)]
    here, there = _made(branch, modules), _made(beside, modules)
    known = {name for one in (*here, *there) for name in one.names}
    if all(name in known for settings in (*given[0], *given[1]) for name in settings) and (here or there):
        return [one.parameters for one in here] == [one.parameters for one in there]
    said, before = ([_exact(settings) for settings in turns] for turns in given)
    return said == before


def _exact(settings: Mapping[str, Setting]) -> list[tuple[str, str, Setting]]:
    """True is not 1, as a strategy would see it."""
    return [(name, type(value).__name__, value) for name, value in sorted(settings.items())]


def _made(scenario: Scenario, modules: Sequence[Path]) -> list[MadeSettings]:
    settled = resolve(scenario)
    with made_meanwhile() as made:
        preflight_here(settled, modules)
    return made


def _present(scenario: Scenario, change: Change) -> Turn:
    """Whose turn it is where the branch leaves the run."""
    first, turns = succession.split(scenario.run.strategy)
    return [Turn(0.0, first, scenario.strategy), *(one for one in turns if one.at_s < change.at_s)][-1]


def _from(scenario: Scenario, turn: Turn) -> Scenario:
    first, turns = succession.split(scenario.run.strategy)
    strategy = succession.joined(first, [*(one for one in turns if one.at_s < turn.at_s), turn])
    return scenario.model_copy(update={"run": scenario.run.model_copy(update={"strategy": strategy})})
