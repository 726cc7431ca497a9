"""Commands of `acrc view`: write a view file, show it in a window or browser, or take a screenshot."""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.recordings.topics import RunState, partial_run_sentence, run_state
from acrc_testbed.results.seal import fetch_sentence, remote_recordings
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.hardware_runs import whole_run
from acrc_testbed.run_model.simulated_runs import RunReader
from acrc_testbed.view.run_drawing import RunDrawing, arrangement, detailed_robots
from actors.observer import viewer
from actors.observer.canvas import Canvas
from actors.observer.layout import ViewerContents, ViewFile
from actors.observer.viewer import OpenViewer
from actors.processes.launcher import scratch_folder
from actors.processes.signals import Interruption
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.recording import read_notes

FILE_NAME: Final = "view.rrd"
SEVERAL_FILE_NAME: Final = "beside.rrd"
"""View file of several runs side by side."""
_POLL_S: Final = 0.1
_CHECK_PERIOD_S: Final = 1.0
"""Period of checking whether the run is running and the viewer open, s."""
_SETTLING_S: Final = 0.5
"""Time for which recordings may still grow after world and radio closed theirs, s."""
Say = Callable[[str], None]


def print_now(sentence: str) -> None:
    """Write a sentence to standard output and flush it."""
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


def save_view(folders: Sequence[Path], robots: Sequence[str], path: Path, say: Say) -> bool:
    """Draw runs into a view file; return True if it is complete.

    `robots`, here and below: robots drawn in detail; empty: the first DETAILED.
    """
    began = time.monotonic()
    return draw_runs(_read_runs(folders, say), path, robots, None, say, began)


def take_screenshot(
    folders: Sequence[Path], robots: Sequence[str], path: Path, second: float | None, say: Say
) -> bool:
    """Take a screenshot of runs at an instant, s; None: in the middle. Return True if it is complete."""
    began, runs = time.monotonic(), _read_runs(folders, say)
    with scratch_folder() as folder:
        view = folder / FILE_NAME
        complete = draw_runs(runs, view, robots, None, say, began)
        shot = viewer.take_screenshot(view, max(run.end for run in runs) / 2 if second is None else second)
    regular_file.write_atomically(path, shot.png)
    say(str(path))
    return complete


def show_view(folders: Sequence[Path], robots: Sequence[str], say: Say) -> bool:
    """Draw runs into a view file and show them; a single running run is followed to its end.

    Opens a window if there is a display, else serves a page to a local browser until Interruption.
    """
    began = time.monotonic()
    is_running = len(folders) == 1 and run_state(folders[0]) is RunState.RUNNING
    path = view_path(folders[0], SEVERAL_FILE_NAME if folders[1:] else FILE_NAME)
    runs = [] if is_running else _read_runs(folders, say)
    opened = _open_viewer(say)
    try:
        if is_running:
            complete = True
            with regular_file.atomic_replacement(path) as part:
                follow_run(folders[0], part, robots, opened, say)
        else:
            complete = draw_runs(runs, path, robots, None if opened is None else opened.address, say, began)
        _serve_until_closed(opened, path, say)
    finally:
        viewer.terminate(opened)
    return complete


def draw_runs(
    runs: Sequence[RunData],
    path: Path,
    robots: Sequence[str],
    send_to: str | None,
    say: Say,
    began: float,
) -> bool:
    """Draw runs side by side into `path`, which appears once it is complete, and to a viewer.

    `began`: start of the command by the monotonic clock, s.
    """
    detailed = [detailed_robots(run.robots, robots) for run in runs]
    arranged = [arrangement(run, each) for run, each in zip(runs, detailed, strict=True)]
    if runs[1:]:  # the longest run sets the time axis of all
        end = max(run.end for run in runs)
        arranged = [
            replace(one, root=f"/{number}", name=run.out.name, end=end)
            for number, (one, run) in enumerate(zip(arranged, runs, strict=True), 1)
        ]
    name = " beside ".join(one.name for one in arranged) if runs[1:] else runs[0].description.title
    what = arranged if runs[1:] else arranged[0]
    with (
        regular_file.atomic_replacement(path) as part,
        ViewFile(part, what, name=name, send_to=send_to) as sheet,
    ):
        drawings = [
            RunDrawing(Canvas(sheet.recording, run.robots, one.root), run, each)
            for run, one, each in zip(runs, arranged, detailed, strict=True)
        ]
        for run, drawing in zip(runs, drawings, strict=True):
            drawing.draw_recorded(run)
        sheet.flush()
        say(f"ground truth and messages shown after {time.monotonic() - began:.1f} s; other data follow")
        faults = []
        for run, drawing in zip(runs, drawings, strict=True):
            drawing.draw_computed(run, last=True)
            sheet.flush()
            lacks = [*_missing_recordings(run), *drawing.missing_data(run)]
            faults += [f"{run.out.name}: {one}" if runs[1:] else one for one in lacks]
        lost = sheet.lost
    for fault in faults:
        say(fault)
    lasted = f"after {time.monotonic() - began:.1f} s"
    say(f"view without the data listed above {lasted}" if faults else f"all data shown {lasted}")
    if lost:
        say(f"the viewer was closed early; the complete view is in {path}")
    return not faults or any(remote_recordings(run.out) for run in runs)


def _missing_recordings(run: RunData) -> list[str]:
    """Return a sentence about recordings that are still on other hosts, if any."""
    left = remote_recordings(run.out)
    return [fetch_sentence(run.out, left)] if left else []


def follow_run(out: Path, path: Path, robots: Sequence[str], opened: OpenViewer | None, say: Say) -> None:
    """Draw a running run into `path` and to a viewer until it ends or the viewer is closed.

    `robots`: robots drawn in detail. Raises AcrcError for a missing or damaged run, or if `path` cannot be
    written.
    """
    while run_state(out) is RunState.RUNNING and not _has_begun(out):
        time.sleep(_POLL_S)
    with RunReader(out, internals=True) as reader:
        run, detailed = reader.description, detailed_robots(reader.robots, robots)
        what = ViewerContents(run.grid, run.robots, detailed, batteries=run.has_batteries)
        with ViewFile(path, what, name="live run", send_to=opened.address if opened else None) as sheet:
            view = None
            try:  # also here, as preparing the drawing takes time
                view = LiveView(reader, sheet, detailed)
                _follow_steps(out, view, sheet, opened, say)
            finally:
                if not isinstance(sys.exception(), Interruption) and (steps := reader.count_unread()):
                    end = view.end if view else 0
                    say(f"the view ends at {end:g} s; {steps} later steps are not included")


class LiveView:
    """Drawing of a run in progress."""

    def __init__(self, reader: RunReader, sheet: ViewFile, detailed: Sequence[str]) -> None:
        self._reader = reader
        self._drawing = RunDrawing(Canvas(sheet.recording, reader.robots), reader.initial_data(), detailed)
        self.end = 0.0
        """Time up to which the run is drawn, s."""

    def draw(self, *, last: bool = False) -> bool:
        """Draw new data; return True if there was any. `last`: no step will follow."""
        run = self._reader.poll(last=last)
        if run is None:
            return False
        self._drawing.draw_recorded(run)
        self._drawing.draw_computed(run, last=last)
        self.end = run.end
        return True


def _has_begun(out: Path) -> bool:
    """Return True if world and radio have written their first records."""
    files = recordings(out)
    return all(actor in files and "run" in read_notes(files[actor]) for actor in ("world", "radio"))


def _follow_steps(out: Path, view: LiveView, sheet: ViewFile, opened: OpenViewer | None, say: Say) -> None:
    checked, state = time.monotonic(), RunState.RUNNING
    while state is RunState.RUNNING:
        if not view.draw():
            time.sleep(_POLL_S)
        if time.monotonic() > checked + _CHECK_PERIOD_S:
            if opened is not None and opened.process.poll() is not None:
                say("the viewer was closed before the run's end")
                return
            sheet.flush()
            checked, state = time.monotonic(), run_state(out)
    if state is RunState.DIED:
        say("the run was cut off: its processes exited without a result")
    settled = time.monotonic() + _SETTLING_S
    while time.monotonic() < settled and view.draw():
        time.sleep(_POLL_S)
    view.draw(last=True)


def _read_runs(folders: Sequence[Path], say: Say) -> list[RunData]:
    """Read runs; report up to when those without an end are drawn."""
    runs = [whole_run(folder) for folder in folders]
    for run in runs:
        if run_state(run.out) is not RunState.ENDED:
            say(partial_run_sentence(run.out, run.end))
    return runs


def view_path(out: Path, name: str = FILE_NAME) -> Path:
    """Return the path of a run's view: in its folder, or in a temporary one if that is not writable."""
    if os.access(out, os.W_OK):
        return out / name
    return Path(tempfile.mkdtemp(prefix="acrc-view-")) / name


def _open_viewer(say: Say) -> OpenViewer | None:
    """Open a viewer; report and return None if that fails."""
    opened = viewer.open_any(say, "the view is written to its file only")
    if opened is not None and opened.page:
        say(f"open {opened.page} in a browser on this machine; press Ctrl-C to stop")
    return opened


def _serve_until_closed(opened: OpenViewer | None, path: Path, say: Say) -> None:
    """Report the path of the view; serve a page until this program or the viewer ends."""
    say(f"the view is in {path}")
    if opened is None or not opened.page:
        return
    try:
        opened.process.wait()
    except Interruption:
        return
    raise AcrcError(f"the viewer exited with code {opened.process.returncode}")
