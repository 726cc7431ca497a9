"""`acrc view`: runs drawn into a view file, shown in a window or a browser, or taken as a picture."""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.recordings.topics import Standing, drawn_until, standing
from acrc_testbed.results.seal import elsewhere, where
from acrc_testbed.run_model.collected import whole_run
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated import RunReader
from acrc_testbed.view.run_drawing import RunDrawing, arrangement, looked_into
from actors.observer import viewer
from actors.observer.canvas import Canvas
from actors.observer.layout import Arrangement, Sheet
from actors.observer.viewer import OpenViewer
from actors.processes.launch import scratch_folder
from actors.processes.signals import Interrupted
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.recording import read_notes

FILE_NAME: Final = "view.rrd"
SEVERAL: Final = "beside.rrd"
"""Of several runs beside one another."""
_POLL_S: Final = 0.1
_LOOK_S: Final = 1.0
"""Between two looks at whether the run goes on, and whether the viewer is open, s."""
_SETTLING_S: Final = 0.5
"""How long recordings may still grow when world and radio have closed theirs, s."""
Say = Callable[[str], None]


def say_at_once(sentence: str) -> None:
    """Write a sentence to standard output and flush it."""
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


def save(folders: Sequence[Path], robots: Sequence[str], path: Path, say: Say) -> bool:
    """Draw runs into a view file; return whether it has everything.

    `robots`, here and below: those drawn in detail; empty: the first DETAILED.
    """
    began = time.monotonic()
    return draw(_read(folders, say), path, robots, None, say, began)


def picture(
    folders: Sequence[Path], robots: Sequence[str], path: Path, second: float | None, say: Say
) -> bool:
    """Draw runs, and take a picture of the window at an instant, s; None: in the middle of the runs."""
    began, runs = time.monotonic(), _read(folders, say)
    with scratch_folder() as folder:
        view = folder / FILE_NAME
        complete = draw(runs, view, robots, None, say, began)
        shot = viewer.take(view, max(run.end for run in runs) / 2 if second is None else second)
    regular_file.write(path, shot.png)
    say(str(path))
    return complete


def show(folders: Sequence[Path], robots: Sequence[str], say: Say) -> bool:
    """Draw runs into a view file and show it meanwhile; a single run that goes on is followed to its end.

    In a window if there is a display. Else it is served to a browser on this machine until Interrupted.
    """
    began = time.monotonic()
    goes_on = len(folders) == 1 and standing(folders[0]) is Standing.GOING_ON
    path = place(folders[0], SEVERAL if folders[1:] else FILE_NAME)
    runs = [] if goes_on else _read(folders, say)
    shown = _opened(say)
    try:
        if goes_on:
            complete = True
            with regular_file.replaced(path) as part:
                follow(folders[0], part, robots, shown, say)
        else:
            complete = draw(runs, path, robots, None if shown is None else shown.address, say, began)
        _rest(shown, path, say)
    finally:
        viewer.end(shown)
    return complete


def draw(
    runs: Sequence[RunData],
    path: Path,
    robots: Sequence[str],
    send_to: str | None,
    say: Say,
    began: float | None = None,
) -> bool:
    """Draw runs beside one another into `path`, which takes its name once it is whole, and to a viewer.

    `began`: when the user began to wait, by the monotonic clock.
    """
    began = time.monotonic() if began is None else began
    detailed = [looked_into(run.robots, robots) for run in runs]
    arranged = [arrangement(run, each) for run, each in zip(runs, detailed, strict=True)]
    if runs[1:]:  # all have the time of the longest, so that lanes and plots are aligned
        end = max(run.end for run in runs)
        arranged = [
            replace(one, root=f"/{number}", name=run.out.name, end=end)
            for number, (one, run) in enumerate(zip(arranged, runs, strict=True), 1)
        ]
    name = " beside ".join(one.name for one in arranged) if runs[1:] else runs[0].description.title
    what: Arrangement | Sequence[Arrangement] = arranged if runs[1:] else arranged[0]
    with regular_file.replaced(path) as part, Sheet(part, what, name=name, send_to=send_to) as sheet:
        drawings = [
            RunDrawing(Canvas(sheet.recording, run.robots, one.root), run, each)
            for run, one, each in zip(runs, arranged, detailed, strict=True)
        ]
        for run, drawing in zip(runs, drawings, strict=True):
            drawing.recorded(run)
        sheet.flush()
        say(f"first picture after {time.monotonic() - began:.1f} s: what was recorded")
        faults = []
        for run, drawing in zip(runs, drawings, strict=True):
            drawing.computed(run, last=True)
            sheet.flush()
            lacks = [*_missing(run), *drawing.lacks(run)]
            faults += [f"{run.out.name}: {one}" if runs[1:] else one for one in lacks]
        lost = sheet.lost
    for fault in faults:
        say(fault)
    lasted = f"after {time.monotonic() - began:.1f} s"
    say(f"drawn {lasted}, without what is named above" if faults else f"all of it {lasted}")
    if lost:
        say(f"the viewer was closed before that: the whole view is in {path}")
    return not faults or any(elsewhere(run.out) for run in runs)


def _missing(run: RunData) -> list[str]:
    """Return where recordings are that were left on hosts."""
    left = elsewhere(run.out)
    return [where(run.out, left)] if left else []


def follow(out: Path, path: Path, robots: Sequence[str], opened: OpenViewer | None, say: Say) -> None:
    """Draw a run that goes on into `path` and to a viewer, until it has ended or the viewer was closed.

    `robots`: to draw in detail. AcrcError where the folder holds no run, a damaged one, or `path` cannot be
    written.
    """
    while standing(out) is Standing.GOING_ON and not _begun(out):
        time.sleep(_POLL_S)
    with RunReader(out, internals=True) as reader:
        what = Arrangement(reader.description.grid, reader.robots, looked_into(reader.robots, robots))
        address = None if opened is None else opened.address
        with Sheet(path, what, name="a run that goes on", send_to=address) as sheet:
            view = LiveView(reader, sheet, what.looked_into)
            try:
                _follow(out, view, sheet, opened, say)
            finally:
                steps = 0 if isinstance(sys.exception(), Interrupted) else reader.unread()
                if steps:
                    later = f"{steps} steps that were recorded later are not in it"
                    say(f"the view ends at {view.end:g} s: {later}")


class LiveView:
    """A run that goes on, drawn as its recordings grow."""

    def __init__(self, reader: RunReader, sheet: Sheet, detailed: Sequence[str]) -> None:
        self._reader = reader
        self._drawing = RunDrawing(Canvas(sheet.recording, reader.robots), reader.beginning(), detailed)
        self.end = 0.0
        """Until when the run is drawn, s."""

    def draw(self, *, last: bool = False) -> bool:
        """Draw what is new; True if there was anything. `last`: no step will follow."""
        run = self._reader.poll(last=last)
        if run is None:
            return False
        self._drawing.recorded(run)
        self._drawing.computed(run, last=last)
        self.end = run.end
        return True


def _begun(out: Path) -> bool:
    """Return whether world and radio have written their first records."""
    files = recordings(out)
    return all(actor in files and "run" in read_notes(files[actor]) for actor in ("world", "radio"))


def _follow(out: Path, view: LiveView, sheet: Sheet, opened: OpenViewer | None, say: Say) -> None:
    look, how = time.monotonic(), Standing.GOING_ON
    while how is Standing.GOING_ON:
        if not view.draw():
            time.sleep(_POLL_S)
        if time.monotonic() > look + _LOOK_S:
            if opened is not None and opened.process.poll() is not None:
                say("the viewer was closed before the run's end")
                return
            sheet.flush()
            look, how = time.monotonic(), standing(out)
    if how is Standing.DIED:
        say("the run has died: its processes are gone, and there is no result")
    settled = time.monotonic() + _SETTLING_S
    while time.monotonic() < settled and view.draw():
        time.sleep(_POLL_S)
    view.draw(last=True)


def _read(folders: Sequence[Path], say: Say) -> list[RunData]:
    """Return the runs; of each that has not ended it is said until when it is drawn."""
    runs = [whole_run(folder, internals=True) for folder in folders]
    for run in runs:
        if standing(run.out) is not Standing.ENDED:
            say(drawn_until(run.out, run.end))
    return runs


def place(out: Path, name: str = FILE_NAME) -> Path:
    """Return the path of a run's view: in its folder, or a temporary one where that cannot be written."""
    if os.access(out, os.W_OK):
        return out / name
    return Path(tempfile.mkdtemp(prefix="acrc-view-")) / name


def _opened(say: Say) -> OpenViewer | None:
    """Open a viewer; None where none opens, which is said."""
    shown = viewer.open_any(say, "the view goes to its file only")
    if shown is not None and shown.page:
        say(f"to see it, open {shown.page} in a browser on this machine; Ctrl-C ends it")
    return shown


def _rest(shown: OpenViewer | None, path: Path, say: Say) -> None:
    """Say where the view is, and serve it until this program or the viewer is ended, if that is a page."""
    say(f"the view is in {path}")
    if shown is None or not shown.page:
        return
    try:
        shown.process.wait()
    except Interrupted:
        return
    raise AcrcError(f"the viewer has ended with exit code {shown.process.returncode}")
