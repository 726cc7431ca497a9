"""What a study's places bring with them, whoever cleans them."""

from collections.abc import Iterator
from typing import Final

from cleaning.places import GOLDEN
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
