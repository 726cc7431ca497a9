"""Style of pictures: colours safe for colour blindness, equal bytes for equal content."""

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

from acrc_testbed.recordings.topics import recorded_span
from acrc_testbed.run_model.data import RunData
from actors.observer import glyphs
from actors.observer.glyphs import Colour
from actors.runtime import regular_file
from actors.runtime.errors import printable
from actors.task.task import Metric, Value


@contextlib.contextmanager
def context(settings: Mapping[str, Any]) -> Iterator[None]:
    """Apply matplotlib's defaults and these settings within the context."""
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # drawn as a box
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, settings))  # typed with literal names
        yield


def with_dark_mode(svg: bytes, dark: Mapping[str, str], rules: str = "") -> bytes:
    """Return a drawing of matplotlib with a dark colour scheme.

    `dark`: replacement of each colour, such as "#22262b"; `rules`: further CSS for dark screens.
    """
    changed = "".join(
        f'[style*="{key}: {light}"]{{{key}:{other} !important}}'
        for light, other in dark.items()
        for key in ("fill", "stroke")
    )
    screen = f"@media (prefers-color-scheme: dark){{{changed}{rules}}}</style>"
    return svg.replace(b"</style>", screen.encode(), 1)


ROBOTS: Final = tuple(glyphs.hexadecimal(one) for one in glyphs.ROBOTS)
"""Robot colours, as in the viewer."""
FLOOR: Final = "#ffffff"
UNKNOWN: Final = "#eceef1"
WALL: Final = "#464a52"
INK: Final = "#22262b"
LOOK: Final[dict[str, Any]] = {
    "font.size": 8.5,
    "font.family": "DejaVu Sans",
    "text.parse_math": False,  # strategy names may contain any character
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "hatch.linewidth": 0.6,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "svg.hashsalt": "acrc",
    "svg.fonttype": "path",
}
"""Settings of pictures; text in SVG files is converted to outlines, independent of fonts."""

HALO: Final[list[patheffects.AbstractPathEffect]] = [patheffects.withStroke(linewidth=2.5, foreground=FLOOR)]
"""Outline of labels on a floor."""

_DARK_GROUND: Final[Colour] = (22, 25, 29)
_CONTRAST: Final = 4.5
"""Minimum contrast of text: success criterion 1.4.3 of WCAG 2.1."""
_DARK_RASTER: Final = "image{filter:invert(.9) hue-rotate(180deg)}"
"""CSS rule for the floor plan: dark free floor and light walls."""


def colour(index: int) -> str:
    """Return the colour of a robot by its index in scenario order."""
    return ROBOTS[index % len(ROBOTS)]


def robot_colour(robots: Sequence[str], *names: str) -> str:
    """Return the colour of the first name that is a robot; that of texts if there is none."""
    return next((colour(robots.index(name)) for name in names if name in robots), INK)


def title(run: RunData) -> str:
    """Return a title with robots, seed and result."""
    count, result = len(run.robots), run.result
    robots = "1 robot" if count == 1 else f"{count} robots"
    if result is None:
        return f"{robots}, seed {run.description.seed}: {recorded_span(run.out, run.end)}"
    return f"{short_title(run)}   ({robots}, seed {result.seed}, digest {result.digest[:8]})"


def short_title(run: RunData) -> str:
    """Return a title with strategy and result."""
    if run.result is None:
        return recorded_span(run.out, run.end)
    strategy = run.result.origin.strategy or "a strategy"
    return f"{strategy}: {_first_value(run)} in {run.result.finished_s:g} s"


def _first_value(run: RunData) -> str:
    """Return the value of the metric that decides first, such as "6 of 6 items"."""
    assert run.result is not None
    if (metric := _first_metric(run)) is None:
        return "no metric"
    return f"{_text(run.result.task.get(metric.column))}{of_total(run)} {printable(metric.unit)}"


def of_total(run: RunData) -> str:
    """Return the largest value of the metric that decides first, such as " of 40"; "" if it is unknown."""
    metric, values = _first_metric(run), {} if run.result is None else run.result.task
    total = None if metric is None else values.get(metric.total)
    return "" if total is None else f" of {_text(total)}"


def _first_metric(run: RunData) -> Metric | None:
    ranked = (metric for metric in run.description.task.metrics if metric.rank is not None)
    return min(ranked, key=lambda metric: metric.rank or 0, default=None)


def _text(value: Value) -> str:
    return f"{value:g}" if isinstance(value, float) else printable(str(value))


Axes = axes.Axes


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches; draw it within `context(LOOK)`."""
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def svg(figure: Figure) -> bytes:
    """Return the figure as an SVG with light and dark colour schemes."""
    file = BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    content = file.getvalue()
    return with_dark_mode(content, _dark_colours(content), _DARK_RASTER)


def _dark_colours(svg: bytes) -> dict[str, str]:
    """Return replacements for the colours of a drawing that lack contrast on a dark background."""
    used = {found.decode() for found in re.findall(rb"(?:fill|stroke): (#[0-9a-f]{6})", svg)}
    lightened = {one: glyphs.hexadecimal(_lightened(one)) for one in sorted(used)}
    fixed = {FLOOR: glyphs.hexadecimal(_DARK_GROUND), INK: "#e6e8eb"}
    return {one: fixed.get(one, dark) for one, dark in lightened.items() if dark != one or one in fixed}


def _lightened(colour: str) -> Colour:
    """Return the colour, lightened if necessary for contrast to the dark background."""
    red, green, blue = (int(colour[first : first + 2], 16) for first in (1, 3, 5))
    lighter = (glyphs.faded((red, green, blue), 1 - part / 20, glyphs.WHITE) for part in range(20))
    return next(one for one in lighter if glyphs.contrast(one, _DARK_GROUND) >= _CONTRAST)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG or SVG, by the file's suffix, without dates."""
    dates = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with regular_file.atomic_replacement(path) as part:
        figure.savefig(part, metadata=dates)


Series = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""Simulated times, s, and values, by name."""


def write(series: Series, label: str, path: Path) -> None:
    """Write a line plot as a PNG or SVG file; `label`: label of the values' axis."""
    with context(LOOK):
        figure = new_figure(8.0, 3.5)
        axes = figure.add_subplot()
        for index, (name, (seconds, values)) in enumerate(series.items()):
            axes.plot(seconds, values, color=colour(index), linewidth=1.0, label=name)
        axes.set_xlabel("simulated time, s")
        axes.set_ylabel(label)
        if len(series) <= 16:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        save(figure, path)
