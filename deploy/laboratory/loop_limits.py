"""What a scenario may ask for and emulated devices have not: refused by name, never left out in silence."""

from typing import Final

from actors.radio.presets import preset
from deploy.scenario.tables import Scenario
from deploy.usage import OptionError

_CONDUCTOR: Final = "robots that run by their own clocks have nobody who conducts them"
_AIR: Final = "the boards' air has path loss and nothing else"
_ODOMETRY: Final = "emulated bases have the errors of a Kobuki, or none"


def check(scenario: Scenario) -> None:
    """Raise OptionError, naming each key, for a scenario that emulated devices cannot do justice to."""
    asked = _asked(scenario)
    if asked:
        what = "; ".join(f"{key}: {reason}" for key, reason in asked.items())
        raise OptionError(
            f"--hardware-in-the-loop: the scenario asks for what emulated devices have not: {what}; "
            "leave it out there, or run the scenario without --hardware-in-the-loop"
        )


def note(scenario: Scenario) -> str | None:
    """What the preset's air has and the boards' has not, in a sentence; None: nothing."""
    walls = preset(scenario.radio.preset).propagation.walls
    if scenario.radio.walls == "air" or walls == "air":
        return None
    return (
        f"emulated boards hear through walls: the {walls} that radio preset {scenario.radio.preset!r} has "
        "for them is left out"
    )


def _asked(scenario: Scenario) -> dict[str, str]:
    """The keys that the scenario should stand without, and why."""
    radio, robots = scenario.radio, scenario.robots
    stage = robots.odometry == "stage" or any(robot.odometry == "stage" for robot in scenario.robot)
    asked = {
        "[[event]]": (_CONDUCTOR, bool(scenario.event)),
        "[[wall]]": (_AIR, bool(scenario.wall)),
        "[[wifi]]": (_AIR, bool(scenario.wifi)),
        "[radio] walls": (_AIR, radio.walls not in (None, "air")),
        "[radio] shadowing_db": (_AIR, bool(radio.shadowing_db)),
        "[radio] correlation_distance": (_AIR, radio.shadowing_db != 0 and bool(radio.correlation_distance)),
        'odometry = "stage"': (_ODOMETRY, stage),
    }
    return {key: reason for key, (reason, found) in asked.items() if found}
