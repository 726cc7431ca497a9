"""How all pictures look, and how they are written: the same bytes for the same numbers."""

import contextlib
import io
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from actors.runtime import regular_file
from actors.runtime.errors import printable
from observation.picture.look import applied as settings_applied
from observation.picture.look import dark_too

INK: Final = "#1b1f24"
FAINT: Final = "#6a737d"
GRID: Final = "#d0d5db"
PAPER: Final = "#fdfdfc"
PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#7f7f7f")
"""Told apart by the colour-blind: Okabe and Ito, "Color Universal Design", 2008, less black and yellow."""
MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X")
LINES: Final = ("-", "--", "-.", ":")
WIDTH: Final = 9.0
"""Inches, of every picture."""
TITLE: Final = 46
"""Letters in a line above a panel of two side by side."""
NARROW: Final = 30
"""Letters in a line where there is less room: beside an axis, in a legend, above a panel beside names."""
_STYLE: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "text.parse_math": False,  # names of strategies may hold anything
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.facecolor": "none",
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "hatch.linewidth": 0.5,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.08,
    "svg.hashsalt": "acrc",
    "svg.fonttype": "path",
}
_DARK: Final = {INK: "#e6e8eb", FAINT: "#9aa3ad", GRID: "#3a4048", PAPER: "#16191d", PALETTE[0]: "#3d9fe0"}
"""What these become where the reader's screen is dark."""


@dataclass(frozen=True)
class Look:
    """How one strategy looks in every picture."""

    colour: str
    marker: str
    line: str


def look(number: int) -> Look:
    """Of the strategy of this number; further ones repeat colours with other lines and marks."""
    turn, place = divmod(number, len(PALETTE))
    return Look(PALETTE[place], MARKERS[(place + turn) % len(MARKERS)], LINES[(place + turn) % len(LINES)])


def applied() -> contextlib.AbstractContextManager[None]:
    """Pictures are made and written in here."""
    return settings_applied(_STYLE)


def panels(count: int, height: float, *, alike: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels in rows of two, each so many inches high. `alike`: in their axes of x."""
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH, max(1.9, rows * height)))
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=alike, squeeze=False)
    axes = list(grid.flat)
    for unused in axes[count:]:
        unused.remove()
    for above in axes[max(0, count - columns) : count]:
        above.xaxis.set_tick_params(labelbottom=True)
    return figure, axes[:count]


def wrapped(name: str, width: int, lines: int) -> str:
    """A name in at most so many lines of so many letters; whole it stands in the tables."""
    told = textwrap.wrap(printable(name), width)
    if len(told) > lines:
        told = [*told[: lines - 1], f"{told[lines - 1][: width - 1]}…"]
    return "\n".join(told)


def png(figure: Figure) -> bytes:
    """On a light ground, for papers and slides."""
    into = io.BytesIO()
    figure.savefig(into, format="png", dpi=150, facecolor=PAPER, metadata={"Software": None})
    return into.getvalue()


def svg(figure: Figure) -> bytes:
    """Without ground; its ink follows whether the reader's screen is light or dark."""
    into = io.BytesIO()
    figure.savefig(into, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return dark_too(into.getvalue(), _DARK)


def save(figure: Figure, folder: Path, name: str) -> bytes:
    """Write both, and give the SVG."""
    drawn = svg(figure)
    figure.set_layout_engine("none")  # once is enough: all keeps its place
    regular_file.write(folder / f"{name}.png", png(figure))
    regular_file.write(folder / f"{name}.svg", drawn)
    return drawn
