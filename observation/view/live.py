"""A run followed from now to its end, for `acrc view` and for `acrc run --view`."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from actors.observer.sheet import Sheet
from actors.observer.viewer import OpenViewer
from actors.processes.signals import Interrupted
from actors.robot.behaviour.foreign import Permit
from actors.runtime.recording import read_notes
from observation.recordings.writers import Standing, standing
from observation.replay.run_recordings import recordings
from observation.view.drawn import Say
from observation.view.following import Following

_POLL_S: Final = 0.1
_LOOK_S: Final = 1.0
"""Between two looks at whether the run goes on, and whether the viewer keeps up, s."""
_STUCK_S: Final = 120.0
"""What is replayed has to come on within so long, s, or it is not waited for: a strategy may hang."""
_SETTLING_S: Final = 0.5
"""So long recordings may still grow when world and radio have closed theirs, s."""


def follow(
    out: Path,
    path: Path,
    robots: Sequence[str],
    opened: OpenViewer | None,
    say: Say,
    *,
    permit: Permit,
    isolate: bool,
) -> None:
    """Draw a run that goes on into `path` and to a viewer, until it has ended and all is drawn.

    Or until the viewer's window is closed. However it comes to its end, what the view lacks is told.
    `robots`: to look into; `trust`: execute their code, whoever wrote it; `isolate`: shut it off.
    AcrcError where the folder holds no run, a damaged one, or `path` cannot be written.
    """
    while standing(out) is Standing.GOING_ON and not _begun(out):
        time.sleep(_POLL_S)
    with Following(out, robots, permit=permit, isolate=isolate) as following:
        address = None if opened is None else opened.address
        with Sheet(path, following.arrangement, name="a run that goes on", send_to=address) as sheet:
            try:
                following.begin(sheet)
                _draw_all(out, following, sheet, opened, say)
            finally:
                if not isinstance(sys.exception(), Interrupted):  # then nothing stays of the view
                    for sentence in following.lack().sentences(following.end):
                        say(sentence)


def _begun(out: Path) -> bool:
    """True once world and radio have said what they are."""
    files = recordings(out)
    return all(actor in files and "run" in read_notes(files[actor]) for actor in ("world", "radio"))


def _draw_all(out: Path, following: Following, sheet: Sheet, opened: OpenViewer | None, say: Say) -> None:
    look, how = time.monotonic(), Standing.GOING_ON
    while how is Standing.GOING_ON:
        if not following.draw():
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
    while time.monotonic() < settled and following.draw():
        time.sleep(_POLL_S)
    following.draw(last=True)
    _draw_rest(following)
    following.finish()


def _draw_rest(following: Following) -> None:
    """What is computed later than it was recorded, as long as that comes on."""
    moved = time.monotonic()
    while not following.complete and time.monotonic() < moved + _STUCK_S:
        if following.draw(last=True):
            moved = time.monotonic()
        else:
            time.sleep(_POLL_S)
