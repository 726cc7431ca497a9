"""Movie of a run: floor, moving robots with recent trails, items and time."""

import contextlib
import itertools
import shutil
import subprocess
import tempfile
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.text import Text
from PIL import Image

from acrc_testbed.picture import floor_picture, marks, run_page, style
from acrc_testbed.picture.floor_picture import ItemGlyph
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.floor import floor_intervals
from actors.array_types import Floats, Octets
from actors.installation.usage import output_file
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.observer import glyphs
from actors.observer.glyphs import MARKS
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable

_FRAMES_PER_S: Final = 10
"""Frame rate of the movie; robots move at 0.3 m/s."""
_TRAIL_S: Final = 20.0
"""Length of the trail behind a robot, simulated s."""
_DPI: Final = 80
_GIF: Final = ".gif"
_MP4: Final = ".mp4"
Pixels = Octets
"""(height, width, 3)."""


class MovieError(AcrcError):
    """A movie that cannot be written."""


def check(path: Path) -> None:
    """Raise OptionError for an unknown file type, MovieError for an MP4 without ffmpeg."""
    output_file("--movie", path, _GIF, _MP4)
    if path.suffix == _MP4 and shutil.which("ffmpeg") is None:
        raise MovieError(f"--movie {path}: the program ffmpeg is not installed; install it or write a .gif")


def write(run: RunData, path: Path, speed: float) -> None:
    """Write the movie; `speed`: simulated seconds per second. Call `check` first."""
    with style.context(style.LOOK):
        scene = _Scene(run)
        pictures = (scene.picture(step) for step in instants(run, speed))
        with regular_file.atomic_replacement(path) as part:
            if path.suffix == _GIF:
                _write_gif(pictures, part, scene.draw_all())
            else:
                _write_mp4(pictures, part, path)


def _write_gif(pictures: Iterator[Pixels], path: Path, colours: Pixels) -> None:
    """Write a GIF with one palette; `colours`: a picture with all colours."""
    palette = Image.fromarray(colours).quantize(256)
    drawn = (Image.fromarray(one).quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures)
    first, others = next(drawn), drawn
    first.save(path, save_all=True, append_images=others, duration=1000 // _FRAMES_PER_S, loop=0)


def _write_mp4(pictures: Iterator[Pixels], part: Path, path: Path) -> None:
    """Write an MP4 to `part`, later renamed to `path`. Raises MovieError with ffmpeg's output."""
    first = next(pictures)
    height, width = (side // 2 * 2 for side in first.shape[:2])  # the codec requires even sides
    command = [
        *("ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{width}x{height}", "-r", str(_FRAMES_PER_S), "-i", "-", "-pix_fmt", "yuv420p", str(part)),
    ]
    with tempfile.TemporaryFile() as messages:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=messages) as ffmpeg:
            assert ffmpeg.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                for one in itertools.chain([first], pictures):
                    ffmpeg.stdin.write(np.ascontiguousarray(one[:height, :width]).tobytes())
        if ffmpeg.returncode:
            messages.seek(0)
            raise MovieError(
                f"--movie {path}: ffmpeg failed: {messages.read().decode(errors='replace').strip()}"
            )


def instants(run: RunData, speed: float) -> Iterator[int]:
    """Yield the steps shown, including the last one."""
    every = max(1, round(speed / _FRAMES_PER_S / in_seconds(run.step_us)))
    last = len(run.seconds) - 1
    yield from range(0, last, every)
    yield last


class _DrawnRobot(NamedTuple):
    """Moving artists of one robot, in drawing order."""

    trail: LineCollection
    disc: Circle
    nose: Line2D
    name: Text


class _Scene:
    """The floor and its changing artists at one step; the background is drawn once."""

    def __init__(self, run: RunData) -> None:
        self._run = run
        self._figure = style.new_figure(*_size(run))
        self._figure.set_dpi(_DPI)
        self._axes = axes = self._figure.add_subplot()
        floor_picture.draw_floor(axes, run.grid)
        doors = floor_picture.draw_doors(axes, run)
        self._few = few = glyphs.is_small_swarm(run.robots)
        self._items: dict[ItemKey, ItemGlyph] = {}
        self._lines: dict[ItemKey, Line2D] = {}
        for _, mark in run.marks:
            if mark.key not in self._lines:
                (self._lines[mark.key],) = axes.plot([mark.x], [mark.y], ls="", zorder=3, visible=False)
        self._done = deque(run_page.done_events(run))
        self._left = deque(run.marks)
        self._objects = [
            (one, marks.draw_object(axes, one.object)) for one in floor_intervals(run.floor, run.end)
        ]
        self._people = [floor_picture.person(at) for at in run.people[0, :, :2]]
        for disc in self._people:
            axes.add_patch(disc)
        self._robots = [_draw_robot(axes, index, few=few) for index, _ in enumerate(run.robots)]
        kinds = {one.object.kind for one, _ in self._objects}
        kinds |= {"door"} if doors else set()
        kinds |= {"person"} if self._people else set()
        states = glyphs.item_marks(run.description.task)
        shown = {states[state] for _, mark in run.marks if (state := mark.state) in states}
        self._figure.legend(
            handles=floor_picture.legend(shown | {MARKS[kind] for kind in kinds}, [run.description.task]),
            loc="outside lower center",
            ncols=3,
        )
        self._title = axes.set_title("0 s", loc="left", fontweight="bold", fontsize=10)
        self._count = 0
        self._words = f"{printable(run.description.task.items)} {printable(run.description.task.done)}"
        self._changing: list[Artist] = [
            *(artist for _, artist in self._objects),
            *self._lines.values(),
            *self._people,
            *itertools.chain.from_iterable(self._robots),
            self._title,
        ]
        for artist in self._changing:
            artist.set_animated(True)
        self._canvas = cast(Any, self._figure.canvas)  # its methods have no types
        self._canvas.draw()
        self._figure.set_layout_engine("none")  # positions stay fixed
        self._floor = self._canvas.copy_from_bbox(self._figure.bbox)

    def picture(self, step: int) -> Pixels:
        """Return the picture of a step; steps must not decrease."""
        self._show(step)
        return self._rendered()

    def draw_all(self) -> Pixels:
        """Return a picture of all artists, for the palette; call it before `picture`."""
        self._move_all(0, 0.0)
        for item in floor_picture.shown_items(self._run):
            self._lines[item.mark.key].set(**floor_picture.item_style(self._run, item, few=self._few))
        for artist in self._changing:
            artist.set_visible(True)
        drawn = self._rendered()
        for line in self._lines.values():
            line.set_visible(False)
        return drawn

    def _rendered(self) -> Pixels:
        self._canvas.restore_region(self._floor)
        for artist in self._changing:
            self._axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _show(self, step: int) -> None:
        """Update the artists for a step; steps must not decrease."""
        run, now = self._run, float(self._run.seconds[step])
        self._move_all(step, now)
        while self._done and self._done[0].instant <= 1e6 * now:
            self._done.popleft()
            self._count += 1
        while self._left and self._left[0][0] <= now:
            _, mark = self._left.popleft()
            floor_picture.show_item(run.description.task, self._items, mark)
            line, item = self._lines[mark.key], self._items.get(mark.key)
            line.set_visible(item is not None)
            if item is not None:
                line.set_data([mark.x], [mark.y])
                line.set(**floor_picture.item_style(run, item, few=self._few))
        self._title.set_text(f"{now:.0f} s   {self._count}{style.of_total(run)} {self._words}")

    def _move_all(self, step: int, now: float) -> None:
        """Update the floor objects, people and robots for a step, which begins at `now`, s."""
        run = self._run
        for interval, artist in self._objects:
            artist.set_visible(interval.begin <= now < interval.end)
        for disc, (x, y) in zip(self._people, run.people[step, :, :2].tolist(), strict=True):
            disc.set_center((x, y))
        first = int(np.searchsorted(run.seconds, now - _TRAIL_S))
        for index, robot in enumerate(self._robots):
            state = "off" if not run.powered[step, index] else "" if run.stepping[step, index] else "frozen"
            robot.name.set_text(f"{run.robots[index]} {state}" if state or self._few else "")
            _move(robot, run.true[first : step + 1, index], alive=not state)


def _size(run: RunData) -> tuple[float, float]:
    """Return the size of the picture, inches: width of a page, height by the floor."""
    width, height = run.grid.corner.x - run.grid.origin.x, run.grid.corner.y - run.grid.origin.y
    return 10.0, min(max(10.0 * height / width + 1.4, 3.6), 10.6)


def _draw_robot(axes: Axes, index: int, *, few: bool) -> _DrawnRobot:
    colour = style.colour(index)
    disc = Circle((0.0, 0.0), glyphs.RADIUS, color=colour, zorder=6)
    axes.add_patch(disc)
    (nose,) = axes.plot([], [], color="w", lw=1.2, zorder=7)
    trail = LineCollection([], colors=[colour], linewidths=1.2, zorder=4)
    axes.add_collection(trail)
    label = axes.text(0.0, 0.0, "", color=colour, fontweight="bold", fontsize=8.5 if few else 6.0, zorder=9)
    return _DrawnRobot(trail, disc, nose, label)


def _move(body: _DrawnRobot, path: Floats, *, alive: bool) -> None:
    """Move a robot along its poses `path`, (steps, 3), newest last."""
    x, y, heading = path[-1].tolist()
    reach = glyphs.RADIUS
    body.disc.set_center((x, y))
    body.disc.set_alpha(1.0 if alive else 0.3)
    body.nose.set_data([x, x + reach * np.cos(heading)], [y, y + reach * np.sin(heading)])
    body.name.set_position((x + 1.4 * reach, y + 1.4 * reach))
    points = path[:, :2]
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    pieces = pieces[np.hypot(*(pieces[:, 1] - pieces[:, 0]).T) < floor_picture.JUMP]
    body.trail.set_segments(list(pieces))
    colour = to_rgb(body.disc.get_facecolor()[:3])
    body.trail.set_color([(*colour, alpha) for alpha in np.linspace(0.05, 0.9, len(pieces)).tolist()])
