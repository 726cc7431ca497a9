"""What a scenario may ask for and a run in real time cannot do: refused by name, not left out in silence."""

from typing import Final

from actors.installation.usage import OptionError
from deploy.scenario.events import action_of
from deploy.scenario.tables import Scenario

ACTIONS: Final = ("jam", "lose", "obstacle")
"""Of events: what happens to air and floor. The others are orders to the conductor of a simulated run."""
_CONDUCTOR: Final = "robots that run by their own clocks have nobody who conducts them"
_ODOMETRY: Final = "emulated bases have the errors of a Kobuki, or none"


def check(scenario: Scenario) -> None:
    """Raise OptionError, naming each key, for a scenario that cannot be carried out in real time."""
    asked = _asked(scenario)
    if asked:
        what = "; ".join(f"{key}: {reason}" for key, reason in asked.items())
        raise OptionError(
            f"--hardware-in-the-loop: the scenario asks for what emulated devices have not: {what}; "
            "leave it out there, or run the scenario without --hardware-in-the-loop"
        )


def _asked(scenario: Scenario) -> dict[str, str]:
    """The keys that the scenario should stand without, and why."""
    actions = [action_of(event) for event in scenario.event]
    asked = {f"[[event]] {action}": _CONDUCTOR for action in actions if action not in ACTIONS}
    if "stage" in (scenario.robots.odometry, *(robot.odometry for robot in scenario.robot)):
        asked['odometry = "stage"'] = _ODOMETRY
    return asked
