"""What `acrc view` does: it draws a run, and shows it in a window, in a browser, or as a picture."""

import time
from pathlib import Path

from acrc_testbed.recordings.topics import Standing, drawn_until, standing
from acrc_testbed.run_model.collected import whole_run
from acrc_testbed.run_model.data import RunData
from acrc_testbed.view import live
from acrc_testbed.view.drawn import Say, Wishes, draw, place
from actors.observer import viewer
from actors.observer.viewer import OpenViewer
from actors.processes.kernels import compile_kernels
from actors.processes.launch import scratch_folder
from actors.processes.signals import Interrupted
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import choose, warn


def save(out: Path, wishes: Wishes, path: Path, say: Say) -> bool:
    """Draw the run in `out` into a view file; return whether it has everything, as all these functions do."""
    began = time.monotonic()
    return draw(so_far(out, say), path, wishes, send_to=None, say=say, began=began)


def picture(out: Path, wishes: Wishes, path: Path, second: float | None, say: Say) -> bool:
    """Draw the run, and take a picture of the window at an instant, s; None: in the middle of the run."""
    began = time.monotonic()
    run = so_far(out, say)
    with scratch_folder() as folder:
        view = folder / "view.rrd"
        complete = draw(run, view, wishes, send_to=None, say=say, began=began)
        shot = viewer.take(view, run.end / 2 if second is None else second)
    regular_file.write(path, shot.png)
    say(str(path))
    return complete


def show(out: Path, wishes: Wishes, say: Say) -> bool:
    """Draw the run into its view file, and show it while that happens; one that goes on is followed.

    In a window if there is a display. Else it is served to a browser on this machine until Interrupted, which
    before it is drawn is passed on.
    """
    began = time.monotonic()
    if standing(out) is Standing.GOING_ON:
        _follow(out, wishes, say)
        return True
    run, path = so_far(out, say), place(out)
    shown = opened(say)
    try:
        address = None if shown is None else shown.address
        complete = draw(run, path, wishes, send_to=address, say=say, began=began)
        rest(shown, path, say)
    finally:
        viewer.end(shown)
    return complete


def _follow(out: Path, wishes: Wishes, say: Say) -> None:
    """Show a run that goes on until it has ended, or its window was closed."""
    choice = choose(wishes.isolate)
    warn(choice.warning)
    compile_kernels()
    path = place(out)
    shown = opened(say)
    try:
        with regular_file.replaced(path) as part:
            live.follow(out, part, wishes.robots, shown, say, permit=wishes.permit, isolate=choice.isolate)
        rest(shown, path, say)
    finally:
        viewer.end(shown)


def so_far(out: Path, say: Say) -> RunData:
    """What there is to draw; of a run that has not ended it is said until when."""
    run = whole_run(out)
    if standing(out) is not Standing.ENDED:
        say(drawn_until(out, run.end))
    return run


def opened(say: Say) -> OpenViewer | None:
    """The viewer that is opened here; None where none comes up, which is said."""
    shown = viewer.open_any(say, "the view goes to its file only")
    if shown is not None and shown.page:
        say(f"to see it, open {shown.page} in a browser on this machine; Ctrl-C ends it")
    return shown


def rest(shown: OpenViewer | None, path: Path, say: Say) -> None:
    """Say where the view is, and stay until somebody ends this program or the viewer, if that is a page."""
    say(f"the view is in {path}")
    if shown is None or not shown.page:
        return
    try:
        shown.process.wait()
    except Interrupted:
        return
    raise AcrcError(f"the viewer has ended with exit code {shown.process.returncode}")
