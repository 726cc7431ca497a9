"""Branches: simulated runs repeated in memory with a change from an instant on, and compared."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from msgspec.structs import replace
from rich.console import Console

from acrc_testbed.recordings.record_check import check_run
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
    OrderReplayBus,
    branch_scenario,
    control_scenario,
    first_step_at,
    merge_events,
    parse_branch_point,
    parse_event,
    recorded_orders,
    strategy_settings,
)
from deploy.run.options import RunOptions, check_options, run_folder_name
from deploy.run.start import output_folder
from deploy.run.swarm_replay import SCENARIO, Divergence, divergence
from deploy.scenario.scenario_file import load_scenario, module_folders, parse_settings
from deploy.scenario.tables import Scenario


@dataclass(frozen=True)
class BranchControl:
    """Control run of a branch with changed settings: the same strategy, restarted with its old settings."""

    digest: str
    divergence: Divergence | None
    """First difference between control and branch; None: the new settings have no effect."""


@dataclass(frozen=True)
class BranchResult:
    """Result of a branch."""

    result: RunResult
    divergence: Divergence | None
    """First difference from the original run; None: identical."""
    replay_s: float
    """Wall time up to the branch, s."""
    failed_events: tuple[str, ...]
    """One sentence per event that the world refused or that came after the end."""
    control: BranchControl | None
    """None: no setting was changed, or the strategy was replaced."""


def branch(origin: Path, change: Change, options: RunOptions, *, permit: Permit) -> BranchResult:
    """Repeat the simulated run (or branch) in `origin` with a change, into `options.out`.

    Up to the change both runs must be equal; the run's later orders are repeated. Raises AcrcError for an
    instant after the run's end, if the runs differ before it, and for code that the permit does not cover.
    """
    if not (origin / SCENARIO).is_file():
        raise AcrcError(f"{origin}: contains no {SCENARIO}; give the folder of a simulated run")
    report, files = check_run(origin, strict=False), all_recordings(origin)
    if "world" not in files or "radio" not in files:
        raise AcrcError(f"{origin}: no recording of the world or the radio")
    scenario = load_scenario(origin / SCENARIO)
    step_us = milliseconds(scenario.run.step_ms)
    branch_step = first_step_at(change.at_s, step_us)
    ended = _outcome(origin)
    end = first_step_at(ended.simulated_s, step_us) if report.complete and ended else report.good_until or 0
    if branch_step >= end:
        raise AcrcError(f"{origin}: the run ends at {in_seconds(end * step_us):g} s; branch before that")
    is_changed = change.strategy is not None or bool(change.settings)
    branched = branch_scenario(scenario, change) if is_changed else scenario
    modules = permitted_folders(
        origin / SCENARIO, entry(branched.run.strategy), module_folders(branched), permit
    )
    options = replace(options, modules=modules)
    restarted = control_scenario(scenario, change) if is_changed else None

    started, replay_s = time.monotonic(), 0.0

    def on_progress(progress: Progress) -> None:
        nonlocal replay_s
        if not replay_s and progress.step >= branch_step:
            replay_s = time.monotonic() - started

    def execute(scenario: Scenario, options: RunOptions) -> RunResult:
        orders = OrderReplayBus(merge_events(recorded_orders(files["world"]), change.events, step_us))
        return swarm.run_in_memory(swarm.plan(scenario, options), on_progress, orders)

    result = execute(branched, options)
    difference = None if result.digest == report.digest else divergence(origin, options.out, step_us)
    if difference is not None and difference.step < branch_step:
        raise AcrcError(
            f"{origin}: the repeated run differs before {change.at_s:g} s: {difference.words}; for details: "
            f"`{command_line('replay', origin, modules=permit.modules)}`"
        )
    control = None
    if restarted is not None:
        with TemporaryDirectory(prefix="acrc-") as name:
            control_options = replace(options, out=Path(name) / "control")
            digest = execute(restarted, control_options).digest
            control_difference = (
                None
                if digest == result.digest
                else divergence(control_options.out, options.out, step_us, ("control", "branch"))
            )
            control = BranchControl(digest, control_difference)
    branch_origin = BranchOrigin(
        str(origin.absolute()),
        report.digest,
        change.at_s,
        change.words,
        "" if difference is None else difference.words,
        "" if control is None else control.digest,
        "" if control is None or control.divergence is None else control.divergence.words,
    )
    result = msgspec.structs.replace(
        result, origin=msgspec.structs.replace(result.origin, branch=branch_origin)
    )
    (options.out / "run.json").write_bytes(typed_json.dump(result))
    seal(options.out)
    failed_events = _failed_events(change, step_us, result, ended)
    return BranchResult(result, difference, replay_s, failed_events, control)


class _RunOutcome(msgspec.Struct):
    """Required part of a run's result; an unfinished run has none."""

    simulated_s: float
    refused_orders: tuple[str, ...]


def _outcome(origin: Path) -> _RunOutcome | None:
    path = origin / "run.json"
    return typed_json.read(path, _RunOutcome, "result of a run") if path.is_file() else None


def _failed_events(
    change: Change, step_us: int, result: RunResult, outcome: _RunOutcome | None
) -> tuple[str, ...]:
    """Describe events that the world refused in the branch only, or that came after its end."""
    instants = [in_seconds(first_step_at(event.at_s, step_us) * step_us) for event in change.events]
    refused = [one for one in result.refused_orders if outcome is None or one not in outcome.refused_orders]
    branch_refusals = [
        one for one in refused if any(one.startswith(f"at {instant:g} s: ") for instant in instants)
    ]
    ended = f"the branch ended at {result.simulated_s:g} s"
    return (*branch_refusals, *(f"at {at:g} s: {ended}" for at in instants if at >= result.simulated_s))


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
    origin, at_s = parse_branch_point(place)
    try:
        changed = strategy_settings(parse_settings(settings), origin / SCENARIO)
        change = Change(at_s, strategy, changed, tuple(parse_event(text, at_s) for text in events))
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
        f"branch of {origin} at {at_s:g} s: {changes}; replayed up to there in {branched.replay_s:.1f} s"
    )
    difference = branched.divergence
    if difference is None:
        console.print(f"identical to {origin}: same digest")
    else:
        console.print(f"first difference: {difference.words}")
        robots = ", ".join(f"{robot} from {at:g} s" for robot, at in sorted(difference.robots.items()))
        console.print(f"robots that differ: {robots or 'none'}")
    _print_control(console, branched, at_s)
    if branched.failed_events:
        failed_events = "; ".join(branched.failed_events)
        raise AcrcError(f"{branched.result.out}: not all events took effect: {failed_events}")


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
