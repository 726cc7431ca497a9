"""The observer of one run: Truth in, a recording for rerun and, where there is a display, a window."""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import rerun as rr

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.messages import Drive, Truth
from actors.observer import viewer
from actors.observer.appearance import Appearance
from actors.observer.scene import Scene
from actors.observer.window import blueprint
from actors.runtime.errors import AcrcError

FILE_NAME: Final = "view.rrd"
FLUSH: Final = 10.0
"""How long a slow window may take at the end to take in what it was sent, s."""


class ViewSummary(NamedTuple):
    """How much of the run the view holds."""

    missed: int
    """Steps whose Truth never came."""
    shown: int
    """Pictures drawn."""
    expected: int
    """The first step after all whose Truth came."""
    whole: bool
    """The run's last word has come, so nothing is missing after that."""


class Observer:
    """Draws a run into `out`/view.rrd and, with `window`, live into rerun's viewer.

    Give it every Truth that arrives; it draws at most one per `Appearance.period_us` of simulated time.
    `places` are drawn as crosses in the colour of the robot they belong to, pale once they are reported; of
    those that are given up one stroke is left.
    """

    def __init__(
        self,
        out: Path,
        grid: OccupancyGrid,
        places: Mapping[str, Sequence[Point]] | None = None,
        *,
        window: bool | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        """`window`: None opens one if there is a display. AcrcError if the file cannot be written."""
        appearance = appearance or Appearance()
        self.path = out / FILE_NAME
        _check_writable(self.path)
        self.notice = ""
        """One sentence for the person at the terminal; empty if there is nothing to say."""
        self._period_us = appearance.period_us
        self._expected = 0
        self._missed = 0
        self._whole = False
        self._shown = 0
        self._due = 0
        self._waiting: Truth | None = None
        self._recording = rr.RecordingStream("acrc-testbed")
        self._recording.set_log_time_enabled(False)
        file = rr.FileSink(self.path)
        self._recording.set_sinks(file, *self._window(window), default_blueprint=blueprint(grid, appearance))
        self._scene = Scene(self._recording, grid, places or {}, appearance)

    def truth(self, message: Truth) -> None:
        """Take in the truth of a step; those between two pictures are counted but not drawn."""
        self._missed += max(0, message.step - self._expected)
        self._expected = max(self._expected, message.step + 1)
        self._whole = self._whole or message.halt
        if not message.robots:
            return
        if message.instant < self._due:
            self._waiting = message
        else:
            self._show(message)

    def drive(self, message: Drive) -> None:
        """Take in what a robot says about places; it shows with the next picture."""
        for report in message.reports:
            self._scene.reported(report.owner, report.place)
        for given_up in message.given_up:
            self._scene.given_up(given_up.owner, given_up.place)

    def close(self) -> ViewSummary:
        """Draw the last truth that came, finish the file, and say how much of the run it holds."""
        if self._waiting is not None:
            self._show(self._waiting)
        try:
            self._recording.flush(timeout_sec=FLUSH)
        except RuntimeError:  # rerun says so when a window is gone; the file has everything all the same
            self.notice = f"The window was closed before the run's end: the whole view is in {self.path}."
        self._recording.disconnect()
        return ViewSummary(self._missed, self._shown, self._expected, self._whole)

    def _show(self, message: Truth) -> None:
        self._waiting = None
        self._shown += 1
        self._due = message.instant + self._period_us
        self._scene.show(message)

    def _window(self, wanted: bool | None) -> list[rr.GrpcSink]:
        """Where else to send: the window's address, if there is to be one and it opens."""
        if wanted is None:
            wanted = viewer.has_display(os.environ, sys.platform)
            if not wanted:
                self.notice = f"There is no display: the view goes to {self.path} only."
        if not wanted:
            return []
        try:
            return [rr.GrpcSink(viewer.spawn())]
        except (OSError, RuntimeError) as error:
            self.notice = f"The window does not open ({error}): the view goes to {self.path} only."
            return []


def _check_writable(path: Path) -> None:
    try:
        path.open("wb").close()
    except OSError as error:
        raise AcrcError(f"{path}: the view cannot be written: {error.strerror}.") from error
