"""What the seeds of a study draw beside the strategies' luck: starts, places, odometry, shadowing."""

from collections.abc import Callable
from typing import Any, Final

from actors.robot_model import OdometryKind, load_model
from deploy.scenario.tables import Scenario
from experiments.study.study import Variant

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
    if _odometry(scenario) == "exact":
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
            ("odometry is exact", _odometry(scenario) == "exact"),
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


def _odometry(scenario: Scenario) -> OdometryKind:
    return scenario.robots.odometry or load_model(scenario.robots.model, None).odometry


def _drifting(scenario: Scenario) -> OdometryKind:
    """That of the robots' model; where it has none, a Kobuki's for two wheels, and Stage's for others."""
    model = load_model(scenario.robots.model, None)
    if model.odometry != "exact":
        return model.odometry
    return "kobuki" if model.drive.kind == "differential" else "stage"
