"""`acrc branch`: a recorded run continued with one thing changed."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from actors.console import screen
from actors.installation.usage import OptionError
from actors.processes.kernels import compile_kernels
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from cleaning.strategies import StrategyError, entry
from deploy.branches.branching import Branched, Divergence, branch
from deploy.branches.change import Change, event, strategy_settings
from deploy.branches.change import place as place_of
from deploy.branches.swarm_replay import SCENARIO
from deploy.run import out_folder
from deploy.run.options import RunOptions, checked, folder_name
from deploy.scenario.scenario_file import settings as settings_of
from observation.results import summary


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
        changed = strategy_settings(settings_of(settings), origin / SCENARIO)
        change = Change(at_s, strategy, changed, tuple(event(text, at_s) for text in events))
        typed = "" if strategy is None else entry(strategy)
    except StrategyError as error:
        raise OptionError(f"--strategy: {error}") from None
    name = f"{folder_name(Path(origin.name))}-branch"
    options = checked(RunOptions(out or Path("runs", name), bus="memory", scenario=origin.name, json=json))

    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    with out_folder.dropped_if_empty(options.out), out_folder.writing(options.out):
        compile_kernels(quiet=json)
        branched = branch(origin, change, options, permit=replace(permit, typed=typed))
    summary.print_result(branched.result, json=json)
    console = screen(stderr=True)
    changes = "; ".join(change.words) or "nothing changed"
    console.print(
        f"branch of {origin} at {at_s:g} s: {changes}; up to there again in {branched.again_s:.1f} s",
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
    """Print whether the new values make a difference to the same strategy made anew."""
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
