"""`acrc bench beside`: runs of this state and of another one in turn, and how many times as fast it is."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import median
from typing import Final, get_args

from rich.table import Table

from actors.console import screen
from actors.installation.usage import OptionError, wrong_value
from actors.robot.navigation.navigator import NAVIGATION_PRESETS
from benchmarks.beside.state import HERE, PairedCase, ProjectState, RunCost, here, other, unlike
from benchmarks.statistics.measured import ConfidenceInterval, Measured, average
from deploy.run.options import Bus

ROBOTS: Final = (4, 20, 100)
_MOST_S: Final = 120.0
_LEAST_S: Final = 20.0
_ROBOT_S: Final = 1200.0
"""Robots times simulated seconds of a run, so that all sizes take about as long."""
_WARM_UP_S: Final = 2.0
_WORDS: Final = {
    "wall_s": "wall, first step to last, s",
    "command_s": "wall, the whole command, s",
    "cpu_s": "CPU, all processes, s",
}
Pair = tuple[RunCost, RunCost]
"""Of this state and of the other one."""


def measure(
    commit: str | None = None,
    robots: Sequence[int] = ROBOTS,
    duration: float | None = None,
    seed: int | None = None,
    scenario: Path | None = None,
    bus: str = "zenoh",
    pairs: int = 5,
    navigation: str | None = None,
) -> Measured:
    """Run each number of robots in so many pairs, beside `commit` or the clone in that folder.

    `duration`: simulated s; None: 120 s for few robots, 20 s for many. `navigation`: the preset that this
    state runs with, for one that had another and no word for it; None: the scenario's.
    """
    if commit is None:
        raise OptionError("COMMIT: is missing; must be as in acrc bench beside HEAD~1")
    if bus not in get_args(Bus):
        raise wrong_value("--bus", bus, " or ".join(get_args(Bus)))
    if navigation is not None and navigation not in NAVIGATION_PRESETS:
        raise wrong_value("--navigation", navigation, " or ".join(NAVIGATION_PRESETS))
    if scenario is not None and not scenario.is_file():
        raise wrong_value("--scenario", scenario, "a file")
    path = None if scenario is None else scenario.resolve()
    cases = [
        PairedCase(count, duration or _simulated_s(count), bus, seed, path, navigation) for count in robots
    ]
    mine = here()
    with other(commit) as theirs:
        _warm_up(min(cases, key=lambda case: case.robots), mine, theirs)
        warnings = list(unlike(mine, theirs, cases[0]))
        for sentence in warnings:
            _say(sentence)
        found = [(case, _measured(case, mine, theirs, pairs)) for case in cases]
    figures = [
        {
            "robots": case.robots, "simulated_s": case.seconds, "bus": case.bus,
            "pairs": [{mine.name: asdict(one), theirs.name: asdict(two)} for one, two in of_case],
            "times_as_fast": {name: _times(of_case, name)._asdict() for name in _WORDS},
            "digests_equal": _digests_equal(of_case),
        }
        for case, of_case in found
    ]  # fmt: skip
    shown = [one for case, of_case in found for one in _shown(case, of_case, theirs.name)]
    return Measured({"unlike": warnings, "cases": figures}, [*shown, *warnings])


def _simulated_s(robots: int) -> float:
    return min(_MOST_S, max(_LEAST_S, _ROBOT_S // robots))


def _say(sentence: str) -> None:
    screen(stderr=True).print(sentence)


def _warm_up(case: PairedCase, mine: ProjectState, theirs: ProjectState) -> None:
    """Let both states install what they need, and compile their kernels."""
    for state in (mine, theirs):
        _say(f"{state.name}: installs and compiles what it has not yet …")
        state.run(replace(case, seconds=_WARM_UP_S))


def _measured(case: PairedCase, mine: ProjectState, theirs: ProjectState, pairs: int) -> list[Pair]:
    """Whoever is second in a pair is first in the next: what changes steadily harms both alike."""
    found: list[Pair] = []
    for number in range(pairs):
        _say(f"{case.robots} robots, pair {number + 1} of {pairs} …")
        if number % 2 == 0:
            one = mine.run(case)
            found.append((one, theirs.run(case)))
        else:
            two = theirs.run(case)
            found.append((mine.run(case), two))
    return found


def _times(pairs: Sequence[Pair], name: str) -> ConfidenceInterval:
    """How many times as long the other state takes, pair by pair, on the logarithmic scale."""
    logs = [math.log(getattr(theirs, name) / getattr(mine, name)) for mine, theirs in pairs]
    return ConfidenceInterval(*map(math.exp, average(logs)))


def _digests_equal(pairs: Sequence[Pair]) -> bool:
    return len({one.digest for pair in pairs for one in pair}) == 1


def _shown(case: PairedCase, pairs: Sequence[Pair], name: str) -> list[Table | str]:
    title = f"{case.robots} robots, {case.seconds:g} s simulated, --bus {case.bus}, {len(pairs)} pairs"
    table = Table("medians", HERE, name, "here, times as fast", "95 % interval", title=title)
    for figure, words in _WORDS.items():
        one, two = (median(getattr(run, figure) for run in runs) for runs in zip(*pairs, strict=True))
        times = _times(pairs, figure)
        interval = f"{times.low:.2f} to {times.high:.2f}"
        table.add_row(words, f"{one:.2f}", f"{two:.2f}", f"{times.value:.2f}", interval)
    equal = "equal" if _digests_equal(pairs) else "unlike, so the two do unlike work"
    return [table, f"digests: {equal}"]
