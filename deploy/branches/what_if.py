"""What would have come of a run without what its robots were kept by: branches with one order less each."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from actors.instant import in_seconds, milliseconds
from actors.orders import CloseDoor, Freeze, Kill, Obstacle, OpenDoor, Order, Restart, StartJam, Thaw, Wall
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from deploy.branches.branching import branch
from deploy.branches.change import Change, Omission
from deploy.branches.swarm_replay import SCENARIO
from deploy.run.options import RunOptions
from deploy.scenario.events import timed_orders
from deploy.scenario.scenario_file import load_scenario
from observation.accounting.findings import NO_CONTACT
from observation.accounting.time_spent import Cause, TimeSpent, WhatIf
from observation.evidence.run_evidence import result
from observation.replay.recorded_orders import given_orders
from observation.replay.run_recordings import recordings

MOST: Final = 10
"""Branches; each takes as long as the run."""
_SAME_DOOR: Final = 1.0
"""Two points so near, m, are of one door."""


def omissions(out: Path, spent: TimeSpent) -> tuple[Omission, ...]:
    """What was ordered in the run and has kept robots from getting on, in the order of the instants.

    Raises AcrcError where the run cannot be made again.
    """
    if not (out / SCENARIO).is_file():
        raise AcrcError(f"{out}: has no {SCENARIO}, so it cannot be made again without what kept its robots")
    scenario = load_scenario(out / SCENARIO)
    step_us = milliseconds(scenario.run.step_ms)
    given = given_orders(timed_orders(scenario), step_us, recordings(out)["world"])
    found = []
    for number, (step, order) in enumerate(given):
        words = _words(order, spent)
        if words:
            undone = next((one for one in given[number + 1 :] if _undoes(one[1], order)), None)
            found.append(Omission(words, ((step, order),) if undone is None else ((step, order), undone)))
    return tuple(found)


def what_if(out: Path, omitted: Sequence[Omission], permit: Permit) -> Iterator[WhatIf]:
    """How many more places were done without each. Raises AcrcError, as `branch` does."""
    done = result(out)
    if done is None:
        raise AcrcError(f"{out}: did not end as planned, so there is nothing to compare with")
    step_us = milliseconds(load_scenario(out / SCENARIO).run.step_ms)
    for one in omitted:
        at_s = in_seconds(one.orders[0][0] * step_us)
        with TemporaryDirectory(prefix="acrc-") as folder:
            options = RunOptions(Path(folder) / "branch", bus="memory", json=True)
            branched = branch(out, Change(at_s, without=one), options, permit=permit)
        yield WhatIf(one.words, branched.result.places_done - done.places_done)


def _words(order: Order, spent: TimeSpent) -> str:
    """What there would not be without the order; empty if it kept nobody."""
    lasted = {cause: sum(each[cause.value] for each in spent.robots.values()) for cause in Cause}
    dead = {one.robot for one in spent.blames if one.cause == Cause.BY_DEAD.value}
    match order:
        case Kill(robot) | Freeze(robot) if robot in dead:
            return f"{robot} dead"
        case CloseDoor(x, y) if lasted[Cause.CLOSED_DOOR]:
            return f"the closed door at ({x:g}, {y:g})"
        case Obstacle(x, y) | Wall(x, y) if lasted[Cause.UNREACHABLE]:
            return f"the {type(order).__name__.lower()} at ({x:g}, {y:g})"
        case StartJam(x, y) if any(one.name == NO_CONTACT for one in spent.findings):
            return f"the jam at ({x:g}, {y:g})"
    return ""


def _undoes(later: Order, order: Order) -> bool:
    """True if the later order makes no sense without the earlier one."""
    match order, later:
        case (Kill(one), Restart(other)) | (Freeze(one), Thaw(other)):
            return one == other
        case CloseDoor(x, y), OpenDoor(to_x, to_y):
            return math.hypot(to_x - x, to_y - y) <= _SAME_DOOR
    return False
