"""Start of runs: options, admission of code, output folder, kernels."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from msgspec.structs import replace

from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from cleaning.strategies import StrategyError, entry
from deploy.run import out_folder
from deploy.run.options import RunOptions, check_options
from deploy.scenario.scenario_file import Overrides, load_scenario, module_folders
from deploy.scenario.tables import Scenario

if TYPE_CHECKING:  # importing takes 1 s; wrong options are reported before
    from acrc_testbed.results.result import RunResult
    from actors.processes.launcher import Launcher

    RunFunction = Callable[[Scenario, RunOptions, Launcher | None], RunResult]


class PreparedRun(NamedTuple):
    """A scenario and checked options, with the folders of the strategy's permitted code."""

    scenario: Scenario
    options: RunOptions


def prepare_run(
    file: Path, overrides: Overrides, options: RunOptions, permit: Permit, limit: Sequence[str] = ()
) -> PreparedRun:
    """Load the scenario and check it and the options before any folder is created.

    A strategy in `overrides` was typed by the user, so its module may be in the working directory.
    Raises AcrcError; OptionError for a wrong option.
    """
    options, scenario = check_options(options, limit), load_scenario(file, overrides)
    typed = overrides.strategy is not None
    try:
        behaviour = entry(scenario.run.strategy)
    except StrategyError as error:
        raise OptionError(f"--strategy: {error}") if typed else error from None
    permit = replace(permit, typed=behaviour if typed else "")
    modules = permitted_folders(file, behaviour, module_folders(scenario), permit)
    return PreparedRun(scenario, replace(options, modules=modules))


def with_claimed_folder(prepared: PreparedRun) -> PreparedRun:
    """Return the run with a new output folder; its name is numbered if it exists already."""
    out = prepared.options.out
    return prepared._replace(options=replace(prepared.options, out=out_folder.claim(out.parent, out.name)))


@contextmanager
def output_folder(out: Path, *, quiet: bool) -> Iterator[None]:
    """Compile the kernels, then yield for a run that writes to `out`; disk errors become AcrcErrors.

    After an error an empty folder is removed. `quiet`: do not report the compilation.
    """
    from actors.processes.kernel_compilation import compile_kernels  # noqa: PLC0415

    with out_folder.remove_if_empty(out), out_folder.convert_write_errors(out):
        compile_kernels(quiet=quiet)
        yield


def start_run(
    prepared: PreparedRun,
    *,
    quiet: bool = False,
    replaces: str = "",
    by: "RunFunction | None" = None,
    launcher: "Launcher | None" = None,
) -> "RunResult":
    """Execute a run. Raises AcrcError.

    `replaces`: file that identifies a folder that may be replaced. `by`: called instead of `swarm.run`.
    `launcher`: if already started.
    """
    scenario, options = prepared
    replacing = out_folder.replace_folder(options.out, replaces) if replaces else nullcontext()
    with replacing, output_folder(options.out, quiet=quiet):
        if by is not None:
            return by(scenario, options, None)
        from actors.processes.launcher import create_launcher  # noqa: PLC0415

        # the forkserver imports the actors' modules while this process imports those of the run
        starts_server = options.bus == "zenoh" and launcher is None
        with create_launcher(options.spawn) if starts_server else nullcontext(launcher) as active:
            from deploy.run import swarm  # noqa: PLC0415

            return swarm.run(scenario, options, active)


HEAD_ON: Final = SHIPPED / "scenarios" / "head_on.toml"
_STRATEGIES: Final = ("none", "chapter")
_DEMONSTRATION_S: Final = 150.0
"""1.5 times as long as the robots need with adaptation; without it, they stay blocked."""


def demonstrate(options: RunOptions) -> "dict[str, RunResult]":
    """Run two robots that meet in a passage, without and with adaptation; return results by strategy.

    Each run has a folder in `options.out`, named after its strategy. Raises AcrcError.
    """
    from deploy.run import swarm  # noqa: PLC0415

    return {
        strategy: swarm.run(
            load_scenario(HEAD_ON, Overrides(strategy=strategy, duration=_DEMONSTRATION_S)),
            replace(options, out=options.out / strategy, scenario=HEAD_ON.name),
        )
        for strategy in _STRATEGIES
    }


def demonstration_lines(
    results: "dict[str, RunResult]", reassigned: int, pictures: Sequence[Path]
) -> Iterator[str]:
    """Yield the demonstration's result as three lines; `reassigned`: number of adopted items."""
    without, adapted = results.values()
    yield (
        f"Without adaptation: {_coverage(without)} in {without.finished_s:g} s. The robots block each other "
        "in the doorway."
    )
    yield (
        f"With the chapter's adaptation: {_coverage(adapted)} in {adapted.finished_s:g} s. The blocked "
        f"robots exchange destinations by radio; {reassigned} {adapted.declaration.items} were reassigned."
    )
    yield f"Pictures: {', '.join(map(str, pictures))}"


def _coverage(result: "RunResult") -> str:
    words = result.declaration
    first = next(metric for metric in words.metrics if metric.total)
    return f"{result.task[first.column]} of {result.task[first.total]} {words.items} {words.done}"
