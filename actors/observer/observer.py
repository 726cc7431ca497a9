"""The observer of one run: messages in, a view file and, where one listens, a viewer's window out."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.messages import Drive, Truth
from actors.observer import viewer
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.layout import Arrangement
from actors.observer.scene import Scene
from actors.observer.sheet import Sheet

FILE_NAME: Final = "view.rrd"
PERIOD_US: Final = 100_000
"""Least simulated time between two pictures, µs: ten a second, more than an eye follows."""


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
    """Draws a run into `out`/view.rrd and live into rerun's viewer.

    Give it every Truth that arrives; it draws at most one per PERIOD_US of simulated time.
    """

    def __init__(
        self,
        out: Path,
        grid: OccupancyGrid,
        places: Mapping[str, Sequence[Point]],
        *,
        window: bool = True,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        """`places`: of each robot, in their order. `window`: False opens no viewer, display or not.

        `say` is told what a person at the terminal should know, and where the view is before its file is
        there. AcrcError if that cannot be written.
        """
        self.path = out / FILE_NAME
        self._say = say
        self._expected = 0
        self._missed = 0
        self._whole = False
        self._shown = 0
        self._due = 0
        self._waiting: Truth | None = None
        self._viewer = self._open() if window else None
        self._sheet = Sheet(
            self.path,
            Arrangement(grid, tuple(places)),
            name="a run that goes on",
            send_to=None if self._viewer is None else self._viewer.address,
        )
        self._scene = Scene(Canvas(self._sheet.recording, tuple(places)), grid, places)

    def truth(self, message: Truth) -> None:
        """Take in the truth of a step; those between two pictures are counted but not drawn."""
        missed = max(0, message.step - self._expected)
        if missed:
            self._scene.missed(missed)
        self._missed += missed
        self._expected = max(self._expected, message.step + 1)
        self._whole = self._whole or message.halt
        if not message.robots:
            return
        if message.instant < self._due:
            self._waiting = message
        else:
            self._show(message)

    def drive(self, robot: str, message: Drive) -> None:
        """Take in what a robot says about places and itself; it shows with the next picture."""
        self._scene.heard(robot, message)

    def close(self) -> ViewSummary:
        """Draw the last truth that came, finish the file, and say how much of the run it holds."""
        if self._waiting is not None:
            self._show(self._waiting)
        with self._sheet:
            pass
        viewer.end(self._viewer)
        if self._sheet.lost:
            self._say(f"The window was closed before the run's end: the whole view is in {self.path}.")
        return ViewSummary(self._missed, self._shown, self._expected, self._whole)

    def _show(self, message: Truth) -> None:
        self._waiting = None
        self._shown += 1
        self._due = message.instant + PERIOD_US
        self._scene.show(message)

    def _open(self) -> viewer.OpenViewer | None:
        """A window, or a page where there is no display; None where neither comes up."""
        try:
            if viewer.has_display(os.environ, sys.platform):
                return viewer.open_window()
            opened = viewer.open_page()
        except (OSError, RuntimeError) as error:
            self._say(f"The viewer does not open ({error}): the view goes to {self.path} only.")
            return None
        self._say(f"{viewer.WHILE_IT_GOES_ON}, open {opened.page} in a browser on this machine.")
        return opened
