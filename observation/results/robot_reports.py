"""What robots' processes say of themselves at their end, held to what the world and the radio have seen.

A strategy runs in its robot's process, and can write there what it likes: what is taken from it is marked as
the robots' own word in the result, and what cannot be is named and not counted.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime.errors import printable
from actors.runtime.process import FinalNote
from observation.results import deeco_result, navigation_result
from observation.results.deeco_result import DeecoResult, NodeOutcome, node_outcome
from observation.results.navigation_result import NavigationOutcome, NavigationResult, navigation_outcome
from observation.results.outcome import OutcomeError, Outcomes, own_outcome

OWN_WORD: Final = ("deeco", "navigation", "outcome", "unread")
"""Keys of a run's result that are what robots say of themselves."""
_LONGEST: Final = 300
"""Characters of a sentence's reason."""


class OthersCounts(NamedTuple):
    """What others than the robots have counted."""

    steps: int
    step_us: int
    frames: Mapping[str, Mapping[str, int]]
    """What became of each robot's frames, by the radio."""


class RobotReports(NamedTuple):
    """What all robots said."""

    deeco: DeecoResult
    navigation: NavigationResult
    outcomes: Outcomes
    unread: int
    refused: tuple[str, ...]
    """A sentence for each thing that cannot be."""


def robot_reports(finals: Iterable[tuple[str, Path, FinalNote]], seen: OthersCounts) -> RobotReports:
    """Gather the last records of all robots' processes: each with its robot and its file."""
    refused: list[str] = []
    nodes: dict[str, list[NodeOutcome]] = defaultdict(list)
    navigations: list[NavigationOutcome] = []
    outcomes: Outcomes = defaultdict(dict)
    unread = 0
    for robot, record, final in finals:
        with _refusing(refused, robot, "node"):
            node = node_outcome(record, final.outcome)
            if node is not None:
                _hold(deeco_result.impossible(node, seen.steps))
                nodes[robot].append(node)
        with _refusing(refused, robot, "navigation"):
            navigation = navigation_outcome(record, final.outcome)
            if navigation is not None:
                _hold(navigation_result.impossible(navigation, seen.steps, seen.step_us))
                navigations.append(navigation)
        with _refusing(refused, robot, "outcome"):
            for name, value in own_outcome(record, final.outcome).items():
                outcomes[name][robot] = value
        with _refusing(refused, robot, "messages"):
            arrived = sum(final.arrived.values())
            _hold(f"{final.unread} unread of {arrived}" if final.unread > arrived else None)
            unread += final.unread
    believed: list[NodeOutcome] = []
    for robot, of_robot in nodes.items():
        with _refusing(refused, robot, "node"):
            _hold(deeco_result.contradicted(of_robot, seen.frames.get(robot, {})))
            believed += of_robot
    return RobotReports(
        deeco_result.deeco_result(believed),
        navigation_result.navigation_result(navigations),
        dict(sorted(outcomes.items())),
        unread,
        tuple(refused),
    )


class _ImpossibleError(Exception):
    """What a robot says and what cannot be."""


def _hold(why: str | None) -> None:
    if why is not None:
        raise _ImpossibleError(why)


@contextmanager
def _refusing(refused: list[str], robot: str, subject: str) -> Iterator[None]:
    """What is found impossible within becomes a sentence."""
    try:
        yield
    except (_ImpossibleError, OutcomeError) as error:
        why = printable(str(error)[:_LONGEST]).replace("\n", " ")
        refused.append(f"{robot}: what it says of its {subject} cannot be, and is not counted: {why}")
