"""Branches of a run: it starts again in memory, with a change from an instant on; where both runs part."""

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
    control_of,
    event,
    recorded_orders,
    strategy_settings,
    with_events,
)
from deploy.run.change import place as place_of
from deploy.run.options import RunOptions, checked, folder_name
from deploy.run.start import output_folder
from deploy.run.swarm_replay import SCENARIO, Divergence, divergence
from deploy.scenario.scenario_file import load_scenario, module_folders, parse_settings
from deploy.scenario.tables import Scenario


@dataclass(frozen=True)
class BranchedControl:
    """The control of a branch with other settings: the same strategy, restarted there with its own values."""

    digest: str
    divergence: Divergence | None
    """Where the branch parts from it; None: the values make no difference."""


@dataclass(frozen=True)
class Branched:
    """A branch that was carried out."""

    result: RunResult
    divergence: Divergence | None
    """None: it is the run that it leaves."""
    again_s: float
    """Wall clock that the part up to the branch took, s."""
    undone: tuple[str, ...] = ()
    """A sentence for each event that the world refused, or that came behind the end."""
    control: BranchedControl | None = None
    """None: no setting was changed, or another strategy took over."""


def branch(origin: Path, change: Change, options: RunOptions, *, permit: Permit) -> Branched:
    """Continue the run in the folder `origin`, simulated or a branch itself, into `options.out`.

    Up to the change everything is as it was, and all orders that the run was given later are given again.
    Raises AcrcError for an instant that the run has not come to, and where the part before it does not come
    out the same, and for code that the permit does not cover.
    """
    if not (origin / SCENARIO).is_file():
        raise AcrcError(f"{origin}: contains no {SCENARIO}; give the folder of a simulated run")
    told, files = check(origin, strict=False), all_recordings(origin)
    if "world" not in files or "radio" not in files:
        raise AcrcError(f"{origin}: lacks the recording of the world or of the radio")
    scenario = load_scenario(origin / SCENARIO)
    step_us = milliseconds(scenario.run.step_ms)
    first = boundary(change.at_s, step_us)
    done = _outcome(origin)
    last = boundary(done.simulated_s, step_us) if told.complete and done else (told.good_until or 0)
    if first >= last:
        raise AcrcError(
            f"{origin}: the run ends at {in_seconds(last * step_us):g} s; a branch must leave it before"
        )
    chosen = change.strategy is not None or bool(change.settings)
    branched = changed(scenario, change) if chosen else scenario
    modules = permitted_folders(
        origin / SCENARIO, entry(branched.run.strategy), module_folders(branched), permit
    )
    options = replace(options, modules=modules)
    anew = control_of(scenario, change) if chosen else None

    began, again_s = time.monotonic(), 0.0

    def follow(progress: Progress) -> None:
        nonlocal again_s
        if not again_s and progress.step >= first:
            again_s = time.monotonic() - began

    def carry_out(of: Scenario, into: RunOptions) -> RunResult:
        orders = OrderBus(with_events(recorded_orders(files["world"]), change.events, step_us))
        return swarm.run_in_memory(swarm.plan(of, into), follow, orders)

    result = carry_out(branched, options)
    parted = None if result.digest == told.digest else divergence(origin, options.out, step_us)
    if parted is not None and parted.step < first:
        raise AcrcError(
            f"{origin}: does not come out the same up to {change.at_s:g} s, so there is nothing to continue: "
            f"{parted.words}; `{command_line('replay', origin, modules=permit.modules)}` says more"
        )
    control: BranchedControl | None = None
    if anew is not None:
        with TemporaryDirectory(prefix="acrc-") as name:
            into = replace(options, out=Path(name) / "control")
            digest = carry_out(anew, into).digest
            apart = (
                None
                if digest == result.digest
                else divergence(into.out, options.out, step_us, ("control", "branch"))
            )
            control = BranchedControl(digest, apart)
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
    return Branched(result, parted, again_s, undone, control)


class _RunOutcome(msgspec.Struct):
    """The part of a run's result that is needed here; a run that goes on, or has died, has none."""

    simulated_s: float
    refused_orders: tuple[str, ...]


def _outcome(origin: Path) -> _RunOutcome | None:
    path = origin / "run.json"
    return typed_json.read(path, _RunOutcome, "result of a run") if path.is_file() else None


def _undone(change: Change, step_us: int, result: RunResult, done: _RunOutcome | None) -> tuple[str, ...]:
    """Return what the world refused at the events' boundaries, unlike in the run, and what came too late."""
    instants = [in_seconds(boundary(event.at_s, step_us) * step_us) for event in change.events]
    refused = [one for one in result.refused_orders if done is None or one not in done.refused_orders]
    said = [one for one in refused if any(one.startswith(f"at {instant:g} s: ") for instant in instants)]
    over = f"the branch was over at {result.simulated_s:g} s"
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
    """Carry the branch out and say what came of it."""
    origin, at_s = place_of(place)
    try:
        changed = strategy_settings(parse_settings(settings), origin / SCENARIO)
        change = Change(at_s, strategy, changed, tuple(event(text, at_s) for text in events))
        typed = "" if strategy is None else entry(strategy)
    except StrategyError as error:
        raise OptionError(f"--strategy: {error}") from None
    name = f"{folder_name(Path(origin.name))}-branch"
    options = checked(RunOptions(out or Path("runs", name), bus="memory", scenario=origin.name, json=json))

    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    with output_folder(options.out, quiet=json):
        branched = branch(origin, change, options, permit=replace(permit, typed=typed))
    summary.print_result(branched.result, json=json)
    console = create_console(stderr=True)
    changes = "; ".join(change.words) or "nothing changed"
    console.print(
        f"branch of {origin} at {at_s:g} s: {changes}; up to there again in {branched.again_s:.1f} s"
    )
    parted = branched.divergence
    if parted is None:
        console.print(f"identical: the digest of {origin}")
    else:
        _print_parted(console, parted)
    _print_control(console, branched, at_s)
    if branched.undone:
        undone = "; ".join(branched.undone)
        raise AcrcError(f"{branched.result.out}: a branch without what was asked: {undone}")


def _print_control(console: Console, branched: Branched, at_s: float) -> None:
    """Print whether the new values make a difference to the same strategy restarted."""
    control = branched.control
    if control is None:
        return
    beside = f"beside the control, the same strategy made anew at {at_s:g} s with the values it had: "
    if control.divergence is None:
        console.print(f"{beside}identical, so the new values make no difference")
    else:
        console.print(f"{beside}first difference: {control.divergence.words}")


def _print_parted(console: Console, parted: Divergence) -> None:
    console.print(f"first difference: {parted.words}")
    robots = ", ".join(f"{robot} from {at:g} s" for robot, at in sorted(parted.robots.items()))
    console.print(f"does or meets otherwise: {robots or 'nobody'}")
