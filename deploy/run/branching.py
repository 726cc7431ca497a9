"""Branches: a run repeated in memory with a change from an instant on, and their first difference."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from rich.console import Console

from acrc_testbed.recordings.record_check import check
from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.results import summary
from acrc_testbed.results.result import BranchOrigin, RunResult
from acrc_testbed.results.seal import seal
from actors.console import create_console
from actors.installation.usage import OptionError, command_line
from actors.instant import in_seconds, milliseconds
from actors.messages import Progress
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from cleaning.strategies import StrategyError, entry
from deploy.run import out_folder, swarm
from deploy.run.change import (
    Change,
    OrderBus,
    boundary,
    changed,
    control_scenario,
    event,
    merge_events,
    recorded_orders,
    strategy_settings,
)
from deploy.run.change import place as place_of
from deploy.run.options import RunOptions, check_options, run_folder_name
from deploy.run.start import output_folder
from deploy.run.swarm_replay import SCENARIO, Divergence, divergence
from deploy.scenario.scenario_file import load_scenario, module_folders, parse_settings
from deploy.scenario.tables import Scenario


@dataclass(frozen=True)
class BranchControl:
    """Control of a branch with changed settings: the same strategy, restarted with its old settings."""

    digest: str
    divergence: Divergence | None
    """First difference of the branch from it; None: the new settings have no effect."""


@dataclass(frozen=True)
class BranchResult:
    """Result of a branch."""

    result: RunResult
    divergence: Divergence | None
    """First difference from the original run; None: identical."""
    again_s: float
    """Wall time up to the branch, s."""
    undone: tuple[str, ...] = ()
    """Sentences about events that the world refused, or after the end."""
    control: BranchControl | None = None
    """None: no setting was changed, or the strategy was replaced."""


def branch(origin: Path, change: Change, options: RunOptions, *, permit: Permit) -> BranchResult:
    """Repeat the simulated run (or branch) in `origin` with a change, into `options.out`.

    Before the change everything is equal; later orders of the run are repeated. Raises AcrcError for an
    instant after the run's end, if the part before it differs, and for code that the permit does not cover.
    """
    if not (origin / SCENARIO).is_file():
        raise AcrcError(f"{origin}: contains no {SCENARIO}; give the folder of a simulated run")
    told, files = check(origin, strict=False), all_recordings(origin)
    if "world" not in files or "radio" not in files:
        raise AcrcError(f"{origin}: no recording of the world or the radio")
    scenario = load_scenario(origin / SCENARIO)
    step_us = milliseconds(scenario.run.step_ms)
    first = boundary(change.at_s, step_us)
    done = _outcome(origin)
    last = boundary(done.simulated_s, step_us) if told.complete and done else (told.good_until or 0)
    if first >= last:
        raise AcrcError(f"{origin}: the run ends at {in_seconds(last * step_us):g} s; branch before that")
    chosen = change.strategy is not None or bool(change.settings)
    branched = changed(scenario, change) if chosen else scenario
    modules = permitted_folders(
        origin / SCENARIO, entry(branched.run.strategy), module_folders(branched), permit
    )
    options = replace(options, modules=modules)
    anew = control_scenario(scenario, change) if chosen else None

    began, again_s = time.monotonic(), 0.0

    def follow(progress: Progress) -> None:
        nonlocal again_s
        if not again_s and progress.step >= first:
            again_s = time.monotonic() - began

    def carry_out(of: Scenario, into: RunOptions) -> RunResult:
        orders = OrderBus(merge_events(recorded_orders(files["world"]), change.events, step_us))
        return swarm.run_in_memory(swarm.plan(of, into), follow, orders)

    result = carry_out(branched, options)
    parted = None if result.digest == told.digest else divergence(origin, options.out, step_us)
    if parted is not None and parted.step < first:
        raise AcrcError(
            f"{origin}: the repeated run differs before {change.at_s:g} s: {parted.words}; for details: "
            f"`{command_line('replay', origin, modules=permit.modules)}`"
        )
    control: BranchControl | None = None
    if anew is not None:
        with TemporaryDirectory(prefix="acrc-") as name:
            into = replace(options, out=Path(name) / "control")
            digest = carry_out(anew, into).digest
            apart = (
                None
                if digest == result.digest
                else divergence(into.out, options.out, step_us, ("control", "branch"))
            )
            control = BranchControl(digest, apart)
    about = BranchOrigin(
        str(origin.absolute()),
        told.digest,
        change.at_s,
        change.words,
        "" if parted is None else parted.words,
        "" if control is None else control.digest,
        "" if control is None or control.divergence is None else control.divergence.words,
    )
    result = msgspec.structs.replace(result, origin=msgspec.structs.replace(result.origin, branch=about))
    (options.out / "run.json").write_bytes(typed_json.dump(result))
    seal(options.out)
    undone = _undone(change, step_us, result, done)
    return BranchResult(result, parted, again_s, undone, control)


class _RunOutcome(msgspec.Struct):
    """The required part of a run's result, which an unfinished run does not have."""

    simulated_s: float
    refused_orders: tuple[str, ...]


def _outcome(origin: Path) -> _RunOutcome | None:
    path = origin / "run.json"
    return typed_json.read(path, _RunOutcome, "result of a run") if path.is_file() else None


def _undone(change: Change, step_us: int, result: RunResult, done: _RunOutcome | None) -> tuple[str, ...]:
    """Describe events that the world refused, unlike in the run, or that came after the end."""
    instants = [in_seconds(boundary(event.at_s, step_us) * step_us) for event in change.events]
    refused = [one for one in result.refused_orders if done is None or one not in done.refused_orders]
    said = [one for one in refused if any(one.startswith(f"at {instant:g} s: ") for instant in instants)]
    over = f"the branch ended at {result.simulated_s:g} s"
    return (*said, *(f"at {at:g} s: {over}" for at in instants if at >= result.simulated_s))


def continue_run(
    place: str,
    strategy: str | None,
    settings: Sequence[str],
    events: Sequence[str],
    out: Path | None,
    *,
    permit: Permit,
    json: bool,
) -> None:
    """Carry out a branch and print its result."""
    origin, at_s = place_of(place)
    try:
        changed = strategy_settings(parse_settings(settings), origin / SCENARIO)
        change = Change(at_s, strategy, changed, tuple(event(text, at_s) for text in events))
        typed = "" if strategy is None else entry(strategy)
    except StrategyError as error:
        raise OptionError(f"--strategy: {error}") from None
    name = f"{run_folder_name(Path(origin.name))}-branch"
    options = check_options(
        RunOptions(out or Path("runs", name), bus="memory", scenario=origin.name, json=json)
    )

    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    with output_folder(options.out, quiet=json):
        branched = branch(origin, change, options, permit=replace(permit, typed=typed))
    summary.print_result(branched.result, json=json)
    console = create_console(stderr=True)
    changes = "; ".join(change.words) or "no change"
    console.print(
        f"branch of {origin} at {at_s:g} s: {changes}; replayed up to there in {branched.again_s:.1f} s"
    )
    parted = branched.divergence
    if parted is None:
        console.print(f"identical to {origin}: same digest")
    else:
        _print_parted(console, parted)
    _print_control(console, branched, at_s)
    if branched.undone:
        undone = "; ".join(branched.undone)
        raise AcrcError(f"{branched.result.out}: not all events took effect: {undone}")


def _print_control(console: Console, branched: BranchResult, at_s: float) -> None:
    """Print the difference between the branch and its control."""
    control = branched.control
    if control is None:
        return
    compared = f"compared with the control (same strategy, restarted at {at_s:g} s with its old settings): "
    if control.divergence is None:
        console.print(f"{compared}identical, so the new settings have no effect")
    else:
        console.print(f"{compared}first difference: {control.divergence.words}")


def _print_parted(console: Console, parted: Divergence) -> None:
    console.print(f"first difference: {parted.words}")
    robots = ", ".join(f"{robot} from {at:g} s" for robot, at in sorted(parted.robots.items()))
    console.print(f"robots that differ: {robots or 'none'}")
