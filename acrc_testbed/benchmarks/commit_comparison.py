"""`acrc bench beside`: comparison of this state of the project with another commit, by paired runs."""

import json
import math
import os
import subprocess
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Final, get_args

from rich.table import Table

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, make_table, run_timed
from acrc_testbed.experiments.paired_tests import Interval, mean_interval
from actors.console import create_console
from actors.installation.repository import REPOSITORY, clone
from actors.installation.usage import OptionError, check_choice, wrong_value
from actors.robot.navigation.navigator import NAVIGATION_PRESETS
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import RecordDetail
from deploy.run.options import Bus

HERE: Final = "here"
ROBOTS: Final = (4, 20, 100)
_EXCLUDED_VARIABLES: Final = ("PYTHONPATH", "NUMBA_")
"""Prefixes of environment variables that could load code of one state into the other."""
_MAX_S: Final = 120.0
_MIN_S: Final = 20.0
_ROBOT_S: Final = 1200.0
"""Robots times simulated seconds of a run; makes runs of all sizes take about equally long."""
_WARM_UP_S: Final = 2.0
_FIGURES: Final = {
    "wall_s": "wall, first step to last, s",
    "command_s": "wall, whole command, s",
    "cpu_s": "CPU, all processes, s",
}


@dataclass(frozen=True)
class PairedCase:
    """A swarm that both states run."""

    robots: int
    seconds: float
    """Simulated time, s."""
    bus: str
    seed: int | None = None
    """None: the scenario's."""
    scenario: Path | None = None
    """Absolute; None: the scenario `chapter` of each state."""
    navigation: str | None = None
    """Preset of this state only; None: the scenario's."""
    record: str | None = None
    """Level of recording of this state only; None: its default."""


@dataclass(frozen=True)
class RunCost:
    """Digest and cost of one run."""

    digest: str
    wall_s: float
    """Wall time from the first step to the last."""
    command_s: float
    """Wall time of the whole command."""
    cpu_s: float
    """CPU time of all processes of the command."""


@dataclass(frozen=True)
class ProjectState:
    """A clone whose `acrc` creates its own `.venv` at the first call."""

    name: str
    folder: Path

    @property
    def chapter(self) -> Path:
        """Path of its scenario `chapter`."""
        return self.folder / "scenarios" / "chapter.toml"

    def run(self, case: PairedCase) -> RunCost:
        """Run the case once, in a temporary folder. Raises AcrcError."""
        seed = () if case.seed is None else ("--seed", str(case.seed))
        options = {"--navigation": case.navigation, "--record": case.record} if self.name == HERE else {}
        own = [word for name, value in options.items() if value is not None for word in (name, value)]
        env = {name: value for name, value in os.environ.items() if not name.startswith(_EXCLUDED_VARIABLES)}
        with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
            words = (
                *(str(self.folder / "acrc"), "run", str(case.scenario or self.chapter)),
                *("--robots", str(case.robots), "--duration", f"{case.seconds:g}", *seed, *own),
                *("--bus", case.bus, "--json", "--out", str(Path(folder) / "out")),
            )
            cost = run_timed(words, self.folder, env)
        try:
            result = json.loads(cost.output)
            return RunCost(result["digest"], result["wall_s"], cost.wall_s, cost.cpu_s)
        except (ValueError, KeyError, TypeError):
            raise AcrcError(
                f"{self.name}: acrc run --json printed {cost.output[:80]!r} instead of a result"
            ) from None

    def properties(self) -> dict[str, object]:
        """Return Python version and number of packages of its `.venv`, once it has run, and its scenario."""
        try:
            scenario = tomllib.loads(self.chapter.read_text())
        except (OSError, ValueError) as error:
            raise OptionError(f"{self.chapter}: cannot be read ({error}); use --scenario FILE") from None
        packages = self.folder.glob(".venv/lib/python*/site-packages/*.dist-info")
        python = run_timed([str(self.folder / ".venv" / "bin" / "python"), "-V"]).output.strip()
        return {"Python": python, "number of packages": len(list(packages)), "scenario chapter": scenario}


Pair = tuple[RunCost, RunCost]
"""Costs in this state and in the other state."""


@contextmanager
def open_state(name: str) -> Iterator[ProjectState]:
    """Open the folder of a clone, or a commit in a temporary worktree. Raises OptionError and AcrcError."""
    if Path(name).is_dir():
        if not (Path(name) / "acrc").is_file():
            raise wrong_value("COMMIT", name, "a clone, which contains a file acrc")
        yield ProjectState(name, Path(name).resolve())
        return
    if _git("rev-parse", "--verify", "--quiet", f"{name}^{{commit}}", "--").returncode != 0:
        raise wrong_value("COMMIT", name, "a commit of this repository, or the folder of a clone")
    with tempfile.TemporaryDirectory(prefix="acrc-") as scratch:
        folder = Path(scratch) / "clone"
        try:
            process = _git("worktree", "add", "--detach", str(folder), name)
            if process.returncode != 0:
                raise AcrcError(f"git worktree add {name} fails: {process.stderr.strip()[-300:]}")
            if not (folder / "acrc").is_file():
                raise wrong_value("COMMIT", name, "a commit that contains a file acrc")
            yield ProjectState(name, folder)
        finally:
            _git("worktree", "remove", "--force", str(folder))


def _git(*words: str) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(
            ["git", "-C", str(REPOSITORY), *words], capture_output=True, text=True, check=False
        )
    except OSError as error:
        raise AcrcError(f"git cannot be started: {error.strerror}; give the folder of a clone") from None


def measure(
    commit: str | None = None,
    robots: Sequence[int] = ROBOTS,
    duration: float | None = None,
    seed: int | None = None,
    scenario: Path | None = None,
    bus: str = "zenoh",
    pairs: int = 5,
    navigation: str | None = None,
    record: str | None = None,
) -> BenchmarkResult:
    """Compare this state with `commit` (or the clone in that folder) by `pairs` pairs of runs per swarm size.

    `duration`: simulated s; None: 120 s for few robots, 20 s for many. `navigation`, `record`: preset and
    level of recording of this state only, for states without these options.
    """
    if commit is None:
        raise OptionError("COMMIT: missing; example: acrc bench beside HEAD~1")
    check_choice("--bus", bus, get_args(Bus))
    check_choice("--navigation", navigation, NAVIGATION_PRESETS)
    check_choice("--record", record, get_args(RecordDetail))
    if scenario is not None and not scenario.is_file():
        raise wrong_value("--scenario", scenario, "a file")
    path = None if scenario is None else scenario.resolve()
    lengths = {count: duration or min(_MAX_S, max(_MIN_S, _ROBOT_S // count)) for count in robots}
    cases = [PairedCase(count, lengths[count], bus, seed, path, navigation, record) for count in robots]
    mine = ProjectState(HERE, clone("acrc bench beside"))
    with open_state(commit) as theirs:
        for state in (mine, theirs):
            _log(f"{state.name}: installing packages and compiling kernels …")
            state.run(replace(min(cases, key=lambda case: case.robots), seconds=_WARM_UP_S))
        warnings = list(_differences(mine, theirs, scenario is None))
        for sentence in warnings:
            _log(sentence)
        results = [(case, _run_pairs(case, mine, theirs, pairs)) for case in cases]
    figures = [
        {
            "robots": case.robots, "simulated_s": case.seconds, "bus": case.bus,
            "pairs": [{mine.name: asdict(one), theirs.name: asdict(two)} for one, two in pair_costs],
            "times_as_fast": {name: _speed_up(pair_costs, name)._asdict() for name in _FIGURES},
            "digests_equal": _digests_equal(pair_costs),
        }
        for case, pair_costs in results
    ]  # fmt: skip
    output = [one for case, pair_costs in results for one in _case_output(case, pair_costs, theirs.name)]
    return BenchmarkResult({"unlike": warnings, "cases": figures}, [*output, *warnings])


def _log(sentence: str) -> None:
    create_console(stderr=True).print(sentence)


def _differences(mine: ProjectState, theirs: ProjectState, own_scenarios: bool) -> Iterator[str]:
    """Yield differences of the states that make their times or their work incomparable."""
    one, two = mine.properties(), theirs.properties()
    for name, value in one.items():
        if name != "scenario chapter" and value != two[name]:
            yield f"{name}: {value} here, {two[name]} there; times are not comparable"
        elif own_scenarios and value != two[name]:
            yield f"{name}: differs; use --scenario FILE to run the same one in both"


def _run_pairs(case: PairedCase, mine: ProjectState, theirs: ProjectState, pairs: int) -> list[Pair]:
    """Run the pairs in alternating order, so that machine drift affects both states equally."""
    pair_costs: list[Pair] = []
    for number in range(pairs):
        _log(f"{case.robots} robots, pair {number + 1} of {pairs} …")
        order = (mine, theirs) if number % 2 == 0 else (theirs, mine)
        costs = {state.name: state.run(case) for state in order}
        pair_costs.append((costs[mine.name], costs[theirs.name]))
    return pair_costs


def _speed_up(pairs: Sequence[Pair], name: str) -> Interval:
    """Return the geometric mean over pairs of the other state's figure divided by ours."""
    logs = [math.log(getattr(theirs, name) / getattr(mine, name)) for mine, theirs in pairs]
    return Interval(*map(math.exp, mean_interval(logs)))


def _digests_equal(pairs: Sequence[Pair]) -> bool:
    return len({one.digest for pair in pairs for one in pair}) == 1


def _case_output(case: PairedCase, pairs: Sequence[Pair], name: str) -> list[Table | str]:
    rows = []
    for figure, words in _FIGURES.items():
        one, two = (median(getattr(run, figure) for run in runs) for runs in zip(*pairs, strict=True))
        times = _speed_up(pairs, figure)
        interval = f"{times.low:.2f} to {times.high:.2f}"
        row = {HERE: one, name: two, "speed-up here": times.value, "95 % interval": interval}
        rows.append({"medians": words, **row})
    title = f"{case.robots} robots, {case.seconds:g} s simulated, --bus {case.bus}, {len(pairs)} pairs"
    equal = "equal" if _digests_equal(pairs) else "different: the two states do different work"
    return [make_table(rows, title, ".2f"), f"digests: {equal}"]
