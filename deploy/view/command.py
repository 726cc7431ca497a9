"""What `acrc view` does: it draws a run, and shows it in a window, in a browser, or as a picture."""

import os
import sys
import tempfile
import time
from pathlib import Path

from actors.observer import screenshot, viewer
from actors.observer.viewer import OpenViewer
from actors.runtime.errors import AcrcError
from deploy.processes.signals import Interrupted
from deploy.view.drawn import Say, Wishes, draw, place, read_story


def save(out: Path, wishes: Wishes, path: Path, say: Say) -> None:
    """Draw the run in `out` into a view file, and show it to nobody."""
    began = time.monotonic()
    draw(read_story(out), path, wishes, send_to=None, say=say, began=began)


def picture(out: Path, wishes: Wishes, path: Path, second: float | None, say: Say) -> None:
    """Draw the run, and take a picture of the window at an instant, s; None: in the middle of the run."""
    began = time.monotonic()
    story = read_story(out)
    with tempfile.TemporaryDirectory(prefix="acrc-view-") as folder:
        view = Path(folder) / "view.rrd"
        draw(story, view, wishes, send_to=None, say=say, began=began)
        shot = screenshot.take(view, story.end / 2 if second is None else second)
    path.write_bytes(shot.png)
    say(str(path))


def show(out: Path, wishes: Wishes, say: Say) -> None:
    """Draw the run into its view file, and show it while that happens.

    In a window if there is a display. Else it is served to a browser on this machine until Interrupted, which
    before it is drawn is passed on.
    """
    began = time.monotonic()
    story, path = read_story(out), place(out)
    opened = _open(say)
    try:
        if opened is not None and opened.page:
            say(f"to see it, open {opened.page} in a browser on this machine; Ctrl-C ends that")
        address = None if opened is None else opened.address
        draw(story, path, wishes, send_to=address, say=say, began=began)
        say(f"the view is in {path}")
        if opened is not None and opened.page:
            _wait(opened)
    finally:
        viewer.end(opened)


def _open(say: Say) -> OpenViewer | None:
    """The window, or the page where there is no display; None where neither comes up."""
    try:
        if viewer.has_display(os.environ, sys.platform):
            return viewer.open_window()
        return viewer.open_page()
    except (OSError, RuntimeError) as error:
        say(f"the viewer does not open: {error}")
        return None


def _wait(opened: OpenViewer) -> None:
    """Until somebody ends this program or the viewer."""
    try:
        opened.process.wait()
    except Interrupted:
        return
    raise AcrcError(f"the viewer has ended with exit code {opened.process.returncode}")
