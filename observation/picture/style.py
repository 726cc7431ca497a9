"""How pictures look: colours that colour-blind people tell apart, and the same bytes for the same content."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from matplotlib import patheffects
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from actors.observer import colours
from actors.runtime import regular_file
from observation.evidence.run_evidence import RunEvidence

ROBOTS: Final = tuple(colours.hexadecimal(one) for one in colours.ROBOTS)
"""The same as in the viewer."""
FLOOR: Final = "#ffffff"
UNKNOWN: Final = "#eceef1"
WALL: Final = "#464a52"
INK: Final = "#22262b"
_FEW: Final = 12
LOOK: Final[dict[str, Any]] = {
    "font.size": 8.5,
    "font.family": "DejaVu Sans",
    "text.parse_math": False,  # names of strategies may hold anything
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "acrc",
    "svg.fonttype": "path",
}
"""Letters of an SVG are outlines, so that it looks the same everywhere."""

HALO: Final[list[patheffects.AbstractPathEffect]] = [patheffects.withStroke(linewidth=2.5, foreground=FLOOR)]
"""Around words on a floor, which walls and trails would run into otherwise."""


def colour(index: int) -> str:
    """The colour of the robot with this index in the run's order."""
    return ROBOTS[index % len(ROBOTS)]


def few(robots: Sequence[str]) -> bool:
    """True if there are so few that each has its name, and its places their marks."""
    return len(robots) <= _FEW


def title(run: RunEvidence) -> str:
    """What run it is and what came of it."""
    count, result = len(run.robots), run.result
    robots = "1 robot" if count == 1 else f"{count} robots"
    if result is None:
        return f"{robots}, seed {run.setup.seed}: cut off after {run.end:g} s"
    return f"{short_title(run)}   ({robots}, seed {result.seed}, digest {result.digest[:8]})"


def short_title(run: RunEvidence) -> str:
    """The strategy, and what came of it."""
    if run.result is None:
        return f"cut off after {run.end:g} s"
    strategy = run.result.origin.strategy or "a strategy"
    done = f"{run.result.places_done} of {run.result.places_total} places"
    return f"{strategy}: {done} in {run.result.simulated_s:g} s"


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size, inches; to be drawn while LOOK is applied."""
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def svg(figure: Figure) -> bytes:
    """The figure as an SVG, without anything that differs from day to day."""
    file = BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a PNG or an SVG, by the file's ending, without anything that differs from day to day."""
    dates = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with regular_file.replaced(path) as part:
        figure.savefig(part, metadata=dates)
