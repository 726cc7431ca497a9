"""Look of pictures: colours that colour-blind people tell apart, the same bytes for the same content."""

import contextlib
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final, cast

import matplotlib as mpl
from matplotlib import axes, patheffects
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from acrc_testbed.recordings.topics import so_far
from acrc_testbed.run_model.data import RunData
from actors.observer import glyphs
from actors.observer.glyphs import Colour
from actors.runtime import regular_file


@contextlib.contextmanager
def applied(settings: Mapping[str, Any]) -> Iterator[None]:
    """Pictures are made and written in here, by matplotlib's defaults and these settings of it."""
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # it becomes a box, as anywhere else
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, settings))  # its type lists all settings by name
        yield


def dark_too(svg: bytes, dark: Mapping[str, str], rules: str = "") -> bytes:
    """A drawing of matplotlib's that follows whether the reader's screen is light or dark.

    `dark`: what colours, as "#22262b", become on a dark one; `rules`: what else holds there, in CSS.
    """
    changed = "".join(
        f'[style*="{key}: {light}"]{{{key}:{other} !important}}'
        for light, other in dark.items()
        for key in ("fill", "stroke")
    )
    screen = f"@media (prefers-color-scheme: dark){{{changed}{rules}}}</style>"
    return svg.replace(b"</style>", screen.encode(), 1)


ROBOTS: Final = tuple(glyphs.hexadecimal(one) for one in glyphs.ROBOTS)
"""The same as in the viewer."""
FLOOR: Final = "#ffffff"
UNKNOWN: Final = "#eceef1"
WALL: Final = "#464a52"
INK: Final = "#22262b"
LOOK: Final[dict[str, Any]] = {
    "font.size": 8.5,
    "font.family": "DejaVu Sans",
    "text.parse_math": False,  # names of strategies may hold anything
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "acrc",
    "svg.fonttype": "path",
}
"""Letters of an SVG are outlines, so that it looks the same everywhere."""

HALO: Final[list[patheffects.AbstractPathEffect]] = [patheffects.withStroke(linewidth=2.5, foreground=FLOOR)]
"""Around words on a floor, which walls and trails would run into otherwise."""

_DARK_GROUND: Final[Colour] = (22, 25, 29)
_CONTRAST: Final = 4.5
"""What words have at least to the ground that they lie on: success criterion 1.4.3 of WCAG 2.1."""
_DARK_RASTER: Final = "image{filter:invert(.9) hue-rotate(180deg)}"
"""The floor plan is one: its free floor becomes nearly as dark as the ground, its walls become light."""


def colour(index: int) -> str:
    """The colour of the robot with this index in the run's order."""
    return ROBOTS[index % len(ROBOTS)]


def title(run: RunData) -> str:
    """What run it is and what came of it."""
    count, result = len(run.robots), run.result
    robots = "1 robot" if count == 1 else f"{count} robots"
    if result is None:
        return f"{robots}, seed {run.description.seed}: {so_far(run.out, run.end)}"
    return f"{short_title(run)}   ({robots}, seed {result.seed}, digest {result.digest[:8]})"


def short_title(run: RunData) -> str:
    """The strategy, and what came of it."""
    if run.result is None:
        return so_far(run.out, run.end)
    strategy = run.result.origin.strategy or "a strategy"
    done = f"{run.result.places_done} of {run.result.places_total} places"
    return f"{strategy}: {done} in {run.result.simulated_s:g} s"


Axes = axes.Axes


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size, inches; to be drawn while LOOK is applied."""
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def svg(figure: Figure) -> bytes:
    """The figure as an SVG for a page, light or dark as the reader's screen is."""
    file = BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    drawn = file.getvalue()
    return dark_too(drawn, _dark(drawn), _DARK_RASTER)


def _dark(drawn: bytes) -> dict[str, str]:
    """What the colours of a drawing become on a dark ground: what could not be seen there becomes lighter."""
    used = {found.decode() for found in re.findall(rb"(?:fill|stroke): (#[0-9a-f]{6})", drawn)}
    seen = {one: glyphs.hexadecimal(_seen(one)) for one in sorted(used)}
    exchanged = {FLOOR: glyphs.hexadecimal(_DARK_GROUND), INK: "#e6e8eb"}
    return {one: exchanged.get(one, dark) for one, dark in seen.items() if dark != one or one in exchanged}


def _seen(colour: str) -> Colour:
    """The colour, or one lighter than it that has enough contrast to the dark ground."""
    red, green, blue = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    lighter = (glyphs.faded((red, green, blue), 1 - part / 20, glyphs.WHITE) for part in range(20))
    return next(one for one in lighter if glyphs.contrast(one, _DARK_GROUND) >= _CONTRAST)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG or an SVG, by the file's ending, without anything that differs from day to day."""
    dates = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with regular_file.replaced(path) as part:
        figure.savefig(part, metadata=dates)


Series = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""By name: simulated s, and values."""


def write(series: Series, label: str, path: Path) -> None:
    """One line for each name, as a PNG or SVG file; `label` says what the values are."""
    with applied(LOOK):
        figure = new_figure(8.0, 3.5)
        axes = figure.add_subplot()
        for index, (name, (seconds, values)) in enumerate(series.items()):
            axes.plot(seconds, values, color=colour(index), linewidth=1.0, label=name)
        axes.set_xlabel("simulated time, s")
        axes.set_ylabel(label)
        if len(series) <= 16:
            axes.legend(frameon=False, fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        save(figure, path)
