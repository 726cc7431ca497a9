"""What the tables [places] and [[robot]] of a scenario say together."""

from deploy.scenario.tables import Scenario


def fault(scenario: Scenario) -> str | None:
    """What is wrong between the tables, in words without an end; None if nothing is."""
    return _ids(scenario) or _places(scenario)


def _ids(scenario: Scenario) -> str | None:
    seen: set[str] = set()
    for index, robot in enumerate(scenario.robot):
        if robot.id not in scenario.ids:
            return f'robot[{index}].id is "{robot.id}", but must be {known_robots(scenario)}'
        if robot.id in seen:
            return f'robot[{index}].id is "{robot.id}" once more, but each robot must have one table only'
        seen.add(robot.id)
    return None


def _places(scenario: Scenario) -> str | None:
    if scenario.places.preset != "listed":
        return None
    if scenario.places.per_robot is not None:
        return (
            f"places.per_robot is {scenario.places.per_robot}, but must be left out where"
            ' places.preset is "listed"'
        )
    listed = {robot.id for robot in scenario.robot if robot.places is not None}
    for robot in scenario.ids:
        if robot not in listed:
            return (
                f'places.preset is "listed", but {robot} lists none: a [[robot]] table must hold its places'
            )
    return None


def known_robots(scenario: Scenario) -> str:
    """The robots there are, for a sentence."""
    first, last = scenario.ids[0], scenario.ids[-1]
    return f"the only robot, {first}" if first == last else f"one of the robots {first} to {last}"
