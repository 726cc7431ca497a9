"""Run scenarios, open runs, and read them as tables and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from acrc_testbed.argument_names import arguments_named
from acrc_testbed.shipped import file_of
from actors.installation.usage import output_file
from actors.runtime.errors import AcrcError

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.figure import Figure

    from acrc_testbed.explanation.time_spent import TimeSpent
    from acrc_testbed.results.result import RunResult
    from acrc_testbed.run_model.data import RunData

_MARK: Final = "world/world.mcap"
"""A file of every run."""


@dataclass(frozen=True)
class Run:
    """A run's folder; the run may be completed, interrupted or in progress."""

    folder: Path

    @cached_property
    def data(self) -> "RunData":
        """Data of the recordings as numpy arrays by step and robot, read on first use."""
        from acrc_testbed.run_model.simulated_runs import read_run

        return read_run(self.folder)

    @property
    def result(self) -> "RunResult | None":
        """Content of run.json; None if the run is in progress or was interrupted."""
        return self.data.result

    def tables(self) -> "dict[str, pyarrow.Table]":
        """Return the tables of `acrc export` by name; see docs/tables.md."""
        from acrc_testbed.export import parquet_files, table_rows

        return parquet_files.arrow_tables(table_rows.tables(self.folder))

    @arguments_named()
    def picture(self, file: str | PathLike[str] | None = None) -> "Figure":
        """Draw the run on one page: floor, trails, activities, radio, progress.

        `file`: also write it to this .png or .svg file.
        """
        from acrc_testbed.picture import run_page

        return _drawn(lambda: run_page.draw(self.data), file)

    @arguments_named()
    def time_spent(self) -> "TimeSpent":
        """Return the robots' time by cause, as `acrc causes` does."""
        from acrc_testbed.explanation.time_accounting import account_time

        return account_time(self.folder)


@arguments_named()
def run(
    scenario: str | PathLike[str] = "chapter",
    out: str | PathLike[str] | None = None,
    *,
    robots: int | None = None,
    seed: int | None = None,
    duration: float | None = None,
    strategy: str | None = None,
    navigation: str | None = None,
    settings: Mapping[str, object] | None = None,
    bus: Literal["zenoh", "memory"] = "zenoh",
    record: Literal["full", "lean"] = "full",
    modules: Sequence[str | PathLike[str]] = (),
    trust: bool = False,
    overwrite: bool = False,
) -> Run:
    """Run a scenario, given as a file or the name of a shipped one.

    Arguments have the meaning of the options of `acrc run`; `settings` maps keys of the scenario, such as
    "deeco.publish", to values. `out`: a new or empty folder; None: a new one in runs/. `overwrite`: delete an
    earlier run in `out` once the new one has started. Your own strategy is a module in the working directory
    or in a folder of `modules`.
    """
    from acrc_testbed.recordings.topics import RunState, run_state
    from actors.robot.behaviour.code_permit import permit_of
    from deploy.run.options import RunOptions, run_folder_name
    from deploy.run.start import prepare_run, start_run, with_claimed_folder
    from deploy.scenario.scenario_file import Overrides

    file = file_of("scenarios", scenario)
    own = tuple((settings or {}).items())
    overrides = Overrides(
        robots=robots, seed=seed, duration=duration, strategy=strategy, navigation=navigation, settings=own
    )
    folder = Path(out) if out is not None else Path("runs", run_folder_name(file, strategy))
    options = RunOptions(
        folder, bus=bus, record=record, scenario=file.name, hidden=(file.absolute(),), json=True
    )
    prepared = prepare_run(file, overrides, options, permit_of([*map(Path, modules)], trust=trust))
    if out is None:
        prepared = with_claimed_folder(prepared)
    options = prepared.options
    if overwrite and (options.out / _MARK).is_file() and run_state(options.out) is RunState.RUNNING:
        raise AcrcError(f"--out: a run is in progress in {options.out}; choose another folder")
    start_run(prepared, replaces=_MARK if overwrite else "")
    return Run(options.out)


@arguments_named()
def open_run(folder: str | PathLike[str]) -> Run:
    """Open the run in a folder. Raises AcrcError if there is none."""
    from acrc_testbed.recordings.run_recordings import all_recordings

    all_recordings(Path(folder))
    return Run(Path(folder).absolute())


@arguments_named()
def side_by_side(*runs: Run, file: str | PathLike[str] | None = None) -> "Figure":
    """Draw runs side by side, such as one without and one with adaptation; `file`: as in `Run.picture`."""
    from acrc_testbed.picture import run_page

    return _drawn(lambda: run_page.draw_several([one.data for one in runs]), file)


def _drawn(draw: Callable[[], "Figure"], file: str | PathLike[str] | None) -> "Figure":
    from acrc_testbed.picture import style
    from deploy.run import out_folder

    path = None if file is None else output_file("file", Path(file), ".png", ".svg")
    with style.context(style.LOOK):
        figure = draw()
        if path is not None:
            with out_folder.convert_write_errors(path.absolute().parent):
                style.save(figure, path)
    return figure
