"""Carries a branch out: the run once more from its start in memory, and from an instant on with a change."""

import time
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.instant import in_seconds, milliseconds
from actors.messages import Progress
from actors.robot.behaviour import succession
from actors.robot.behaviour.succession import Turn
from actors.runtime.errors import AcrcError
from cleaning.strategies import entry
from deploy.branches.change import Change, boundary, with_events
from deploy.branches.divergence import Divergence, divergence
from deploy.replay.record_check import check
from deploy.replay.recorded_orders import OrderBus, recorded_orders
from deploy.replay.run_recordings import recordings
from deploy.replay.swarm_replay import SCENARIO
from deploy.results.origin import BranchOrigin
from deploy.results.result import RunResult
from deploy.run import swarm
from deploy.run.foreign import beside, refuse_foreign, refuse_missing
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from deploy.scenario.tables import Scenario


class BranchError(AcrcError):
    """A run that cannot be continued from there."""


@dataclass(frozen=True)
class Branched:
    """A branch that was carried out."""

    result: RunResult
    divergence: Divergence | None
    """None: it is the run that it leaves."""
    again_s: float
    """Wall clock that the part up to the branch took, s."""


def branch(origin: Path, change: Change, options: RunOptions, *, trust: bool) -> Branched:
    """Continue the run in the folder `origin`, simulated or a branch itself, into `options.out`.

    Up to the change everything is as it was, and all orders that the run was given later are given again.
    Raises BranchError for an instant that the run has not come to, and where the part before it does not come
    out the same; ForeignCodeError for somebody's code, without `trust`.
    """
    if not (origin / SCENARIO).is_file():
        raise BranchError(f"{origin}: has no {SCENARIO}; it should be the folder of a simulated run")
    told, files = check(origin), recordings(origin)
    if "world" not in files or "radio" not in files:
        raise BranchError(f"{origin}: lacks the recording of the world or of the radio")
    scenario = load_scenario(origin / SCENARIO)
    step_us = milliseconds(scenario.run.step_ms)
    first = boundary(change.at_s, step_us)
    last = _last_step(origin) if told.complete else (told.good_until or 0)
    if first >= last:
        raise BranchError(
            f"{origin}: the run ends at {in_seconds(last * step_us):g} s; a branch must leave it before"
        )
    changed = _changed(scenario, change)
    refuse_missing(origin / SCENARIO, entry(changed.run.strategy), beside(changed))
    if not trust:
        refuse_foreign(origin / SCENARIO, entry(changed.run.strategy), beside(changed))
    plan = swarm.plan(changed, options)
    orders = OrderBus(with_events(recorded_orders(files["world"]), change.events, step_us))
    watch = _Watch(first)
    result = swarm.run_in_memory(plan, watch.follow, orders)
    parted = None if result.digest == told.digest else divergence(origin, options.out, step_us)
    if parted is not None and parted.step < first:
        raise BranchError(
            f"{origin}: does not come out the same up to {change.at_s:g} s, so there is nothing to continue: "
            f"{parted.words}; `acrc replay {origin}` says more"
        )
    about = BranchOrigin(
        str(origin.absolute()), told.digest, change.at_s, change.words, "" if parted is None else parted.words
    )
    result = _with_origin(result, about, options.out)
    return Branched(result, parted, watch.again_s)


class _Watch:
    """Takes the time that it takes to come to a step."""

    def __init__(self, step: int) -> None:
        self._step = step
        self._began = time.monotonic()
        self.again_s = 0.0

    def follow(self, progress: Progress) -> None:
        """Progress comes once a simulated second."""
        if not self.again_s and progress.step >= self._step:
            self.again_s = time.monotonic() - self._began


def _changed(scenario: Scenario, change: Change) -> Scenario:
    """The scenario with the other strategy from the instant on, which is what stands beside the result."""
    if change.strategy is None:
        return scenario
    first, turns = succession.split(scenario.run.strategy)
    kept = [turn for turn in turns if turn.at_s < change.at_s]
    strategy = succession.joined(first, [*kept, Turn(change.at_s, change.strategy)])
    return scenario.model_copy(update={"run": scenario.run.model_copy(update={"strategy": strategy})})


class _Outcome(msgspec.Struct):
    """The part of a result that says how long the run was."""

    simulated_s: float


def _last_step(origin: Path) -> int:
    scenario = load_scenario(origin / SCENARIO)
    done = msgspec.json.decode((origin / "run.json").read_bytes(), type=_Outcome)
    return boundary(done.simulated_s, milliseconds(scenario.run.step_ms))


def _with_origin(result: RunResult, about: BranchOrigin, out: Path) -> RunResult:
    origin = msgspec.structs.replace(result.origin, branch=about)
    result = msgspec.structs.replace(result, origin=origin)
    (out / "run.json").write_bytes(msgspec.json.format(msgspec.json.encode(result)) + b"\n")
    return result
