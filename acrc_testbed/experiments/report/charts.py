"""Charts of a report: box plots, curves, stacked bars, dot plots; reproducible files."""

import io
import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from acrc_testbed.experiments.paired_tests import Interval
from acrc_testbed.experiments.statistical_models import Completion, SurvivalCurve
from acrc_testbed.picture.style import with_dark_mode
from actors.runtime import regular_file
from actors.runtime.errors import printable

INK: Final = "#1b1f24"
FAINT: Final = "#6a737d"
GRID: Final = "#d0d5db"
PAPER: Final = "#fdfdfc"
PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#7f7f7f")
"""Safe for colour vision deficiency: Okabe and Ito, "Color Universal Design", 2008."""
MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X")
LINES: Final = ("-", "--", "-.", ":")
WIDTH: Final = 9.0
"""Width of every picture, inches."""
TITLE: Final = 46
"""Characters per line of a panel's title."""
NARROW: Final = 30
"""Characters per line of tick labels, legends and narrow titles."""
STYLE: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "text.parse_math": False,  # names may contain $
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
"""Replacements of colours in dark mode."""


@dataclass(frozen=True)
class SeriesStyle:
    """Style of a strategy, the same in every picture."""

    colour: str
    marker: str
    line: str


def series_style(number: int) -> SeriesStyle:
    """Return the style of strategy `number`; colours repeat with other lines and markers."""
    turn, index = divmod(number, len(PALETTE))
    return SeriesStyle(
        PALETTE[index], MARKERS[(index + turn) % len(MARKERS)], LINES[(index + turn) % len(LINES)]
    )


def panels(count: int, height: float, *, alike: bool = True) -> tuple[Figure, list[Axes]]:
    """Create a figure of panels in rows of two, each `height` inches high. `alike`: shared x axis."""
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
    """Wrap a name and cut it after `lines` lines; tables have the full name."""
    parts = textwrap.wrap(printable(name), width)
    if len(parts) > lines:
        parts = [*parts[: lines - 1], f"{parts[lines - 1][: width - 1]}…"]
    return "\n".join(parts)


def png(figure: Figure) -> bytes:
    """Return the figure as PNG with light background, for papers and slides."""
    into = io.BytesIO()
    figure.savefig(into, format="png", dpi=150, facecolor=PAPER, metadata={"Software": None})
    return into.getvalue()


def svg(figure: Figure) -> bytes:
    """Return the figure as transparent SVG that adapts to light and dark mode."""
    into = io.BytesIO()
    figure.savefig(into, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return with_dark_mode(into.getvalue(), _DARK)


def save(figure: Figure, folder: Path, name: str) -> bytes:
    """Write PNG and SVG; return the SVG."""
    drawn = svg(figure)
    figure.set_layout_engine("none")  # keep the layout of the first drawing
    regular_file.write_atomically(folder / f"{name}.png", png(figure))
    regular_file.write_atomically(folder / f"{name}.svg", drawn)
    return drawn


_GOLDEN: Final = 0.6180339887498949
"""Golden ratio; fractional parts of its multiples spread dots of equal values."""
_VISIBLE_RANGE: Final = 0.25
"""Range of values, relative to the largest, below which an axis need not begin at zero."""
_ROW_HEIGHT: Final = 0.42
"""Height of a row, inches."""
_PANEL_MARGIN: Final = 0.95
"""Height of title, axis and margins of a panel, inches."""
_MIN_LABELLED_SHARE: Final = 0.07
"""Share of a bar from which its number is shown."""


@dataclass(frozen=True)
class Box:
    """One row of a box plot."""

    label: str
    look: SeriesStyle
    values: tuple[float, ...]
    at_least: tuple[float, ...] = ()
    """Those of the values that are lower bounds (censored)."""


@dataclass(frozen=True)
class Curve:
    """Share of one strategy's runs with an event over time."""

    label: str
    look: SeriesStyle
    survival: SurvivalCurve
    runs: tuple[Completion, ...]


@dataclass(frozen=True)
class Dot:
    """Estimate with its interval."""

    label: str
    look: SeriesStyle
    mean: Interval | None
    """None: unknown."""


@dataclass(frozen=True)
class Bar:
    """Stacked shares that add up to 1."""

    label: str
    parts: Mapping[str, float]


def draw_boxes(
    conditions: Mapping[str, Sequence[Box]],
    says: str,
    *,
    limit: tuple[float, str] | None = None,
    near: bool = False,
) -> Figure:
    """Draw box plots, a panel for each condition.

    `says`: label of the x axis. `limit`: upper limit and its label. `near`: the axis need not begin at zero.
    """
    figure, axes = _row_panels(conditions)
    for panel, rows in zip(axes, conditions.values(), strict=True):
        for index, row in enumerate(rows):
            _draw_box(panel, index, row)
        if limit is not None:
            panel.axvline(limit[0], color=FAINT, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
        panel.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    lows = [min(row.values) for rows in conditions.values() for row in rows]
    highs = [max(row.values) for rows in conditions.values() for row in rows]
    highest = max(*highs, limit[0] if limit else highs[0])
    begin = _axis_start(min(lows), highest) if near else 0.0
    axes[0].set_xlim(begin, highest + 0.04 * (highest - begin) if highest > begin else begin + 1.0)
    notes = [f"dashed: {limit[1]}"] if limit else []
    notes += ["the axis does not begin at zero"] if begin else []
    _label_x(axes, f"{says} ({'; '.join(notes)})" if notes else says)
    return figure


def draw_survival(conditions: Mapping[str, Sequence[Curve]], horizon: float, says: str) -> Figure:
    """Draw shares of runs over time with 95 % bands, a panel for each condition; `says`: label of y axes."""
    figure, axes = panels(len(conditions), 3.4)
    for panel, (title, curves) in zip(axes, conditions.items(), strict=True):
        panel.set_title(wrapped(title, TITLE, 3) if len(conditions) > 1 else "")
        for curve in curves:
            _draw_curve(panel, curve, horizon)
        panel.set_ylim(-0.03, 1.03)
        panel.yaxis.set_major_formatter(PercentFormatter(1.0))
        panel.set_ylabel(says)
        if len(conditions) > 1:
            panel.legend(loc="best", fontsize=8.5)
    axes[0].set_xlim(0.0, horizon * 1.02)
    if len(conditions) == 1:
        figure.legend(loc="outside right upper", fontsize=8.5)
    _label_x(axes, "simulated time, s")
    return figure


def draw_bars(
    conditions: Mapping[str, Sequence[Bar]], looks: Mapping[str, tuple[str, str]], says: str
) -> Figure:
    """Draw stacked bars, a panel for each condition. `looks`: colour and hatch of each part."""
    figure, axes = _row_panels(conditions, legend=0.35)
    for panel, rows in zip(axes, conditions.values(), strict=True):
        for index, row in enumerate(rows):
            _draw_stack(panel, index, row, looks)
        panel.set_xlim(0.0, 1.0)
        panel.xaxis.set_major_formatter(PercentFormatter(1.0))
    _label_x(axes, says)
    handles, labels = axes[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(
        list(unique.values()), list(unique), loc="outside lower center", ncols=5, fontsize=8.5,
        handlelength=1.4, columnspacing=1.2,
    )  # fmt: skip
    return figure


def draw_dots(quantities: Mapping[str, Sequence[Dot]]) -> Figure:
    """Draw estimates with intervals, a panel for each quantity; its axis includes zero."""
    figure, axes = _row_panels(quantities, 0.9 * _ROW_HEIGHT, alike=False)
    for panel, (title, rows) in zip(axes, quantities.items(), strict=True):
        panel.set_title(wrapped(title, NARROW, 2))
        known = [(index, row.mean, row.look) for index, row in enumerate(rows) if row.mean is not None]
        for index, mean, how in known:
            panel.plot(
                [mean.low, mean.high], [index, index], color=how.colour, linewidth=2.0,
                solid_capstyle="round",
            )  # fmt: skip
            panel.plot([mean.value], [index], how.marker, color=how.colour, markersize=6, clip_on=False)
        panel.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        farthest = (mean.value if math.isnan(mean.high) else mean.high for _, mean, _ in known)
        negative = (mean for _, mean, _ in known if mean.value < 0.0)
        start = min((mean.value if math.isnan(mean.low) else mean.low for mean in negative), default=0.0)
        panel.set_xlim(1.05 * start, 1.05 * max([0.0, *farthest]) or float(start == 0.0))
    return figure


def _row_panels(
    content: Mapping[str, Sequence[Box | Bar | Dot]],
    height: float = _ROW_HEIGHT,
    legend: float = 0.0,
    *,
    alike: bool = True,
) -> tuple[Figure, list[Axes]]:
    """Create a titled panel for each condition, with labelled rows; right panels repeat no equal labels.

    `height`, `legend`: heights of a row and of the legend, inches.
    """
    tallest = max(map(len, content.values()))
    figure, axes = panels(len(content), _PANEL_MARGIN + height * tallest + legend, alike=alike)
    labels = [[wrapped(row.label, NARROW, 2) for row in rows] for rows in content.values()]
    for panel, title, texts in zip(axes, content, labels, strict=True):
        panel.set_title(wrapped(title, TITLE, 3) if len(content) > 1 else "")
        panel.set_yticks(range(len(texts)), texts, fontsize=8.5 if "\n" in "".join(texts) else None)
        panel.set_ylim(len(texts) - 0.4, -0.6)  # the first on top
        panel.grid(visible=False, axis="y")
        panel.tick_params(axis="y", length=0)
    for left in range(0, len(axes) - 1, 2):
        if labels[left] == labels[left + 1]:
            axes[left + 1].tick_params(axis="y", labelleft=False)
    return figure, axes


def _label_x(axes: Sequence[Axes], says: str) -> None:
    """Label the x axis of the lowest panel in each column."""
    for panel in axes[-2:] if len(axes) > 1 else axes:
        panel.set_xlabel(says)


def _axis_start(low: float, high: float) -> float:
    """Return the start of an axis: zero, unless differences would be too small to see."""
    return 0.0 if low == high or high - low > _VISIBLE_RANGE * high else low - 0.5 * (high - low)


def _draw_box(panel: Axes, index: int, row: Box) -> None:
    values, colour = row.values, row.look.colour
    if len(values) > max(4, len(row.at_least)):  # dots suffice for fewer values or lower bounds alone
        panel.bxp(
            boxplot_stats(values),  # Tukey, "Exploratory Data Analysis", 1977; whiskers end outside the box
            positions=[index], widths=0.55, orientation="horizontal", showfliers=False, manage_ticks=False,
            patch_artist=True,
            boxprops={"facecolor": f"{colour}38", "edgecolor": colour, "linewidth": 1.2},
            medianprops={"color": INK, "linewidth": 2.0},
            whiskerprops={"color": colour, "linewidth": 1.2}, capprops={"color": colour, "linewidth": 1.2},
        )  # fmt: skip
    limits = Counter(row.at_least)
    dots: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for number, value in enumerate(values):
        is_limit = limits[value] > 0
        limits[value] -= is_limit
        dots[is_limit].append((value, index + 0.36 * ((number * _GOLDEN) % 1.0 - 0.5)))
    for hollow, points in dots.items():
        if not points:
            continue
        panel.plot(
            *zip(*points, strict=True), linestyle="none",
            marker=">" if hollow else row.look.marker, markersize=4.5,
            markerfacecolor=PAPER if hollow else colour, markeredgecolor=colour, markeredgewidth=1.0,
            alpha=0.85, zorder=3, clip_on=False,
        )  # fmt: skip


def _draw_curve(panel: Axes, curve: Curve, horizon: float) -> None:
    found, how = curve.survival, curve.look
    ends = [*found.times.tolist(), horizon]
    done = [0.0, *(1.0 - found.shares).tolist()]
    count = sum(run.done for run in curve.runs)
    panel.step(
        [0.0, *ends], [*done, done[-1]], where="post", color=how.colour, linestyle=how.line, linewidth=1.8,

        label=f"{wrapped(curve.label, NARROW, 1)}: {count} of {len(curve.runs)}",
    )  # fmt: skip
    if found.times.size:
        upper, lower = (1.0 - found.low).tolist(), (1.0 - found.high).tolist()
        panel.fill_between(
            ends, [*lower, lower[-1]], [*upper, upper[-1]], step="post", color=how.colour, alpha=0.12,
            linewidth=0,
        )  # fmt: skip
    left = [run.at for run in curve.runs if not run.done]
    if left:
        panel.plot(
            left, [1.0 - found.share_at(at) for at in left], linestyle="none", marker="|", markersize=8,
            color=how.colour, markeredgewidth=1.4, clip_on=False,
        )  # fmt: skip


def _draw_stack(panel: Axes, index: int, row: Bar, looks: Mapping[str, tuple[str, str]]) -> None:
    begin = 0.0
    for name, (colour, hatch) in looks.items():
        part = row.parts[name]
        panel.barh(
            [index], [part], left=begin, height=0.62, color=colour, hatch=hatch, edgecolor=PAPER,
            linewidth=0.6, label=name,
        )  # fmt: skip
        if part >= _MIN_LABELLED_SHARE:
            panel.text(
                begin + part / 2, index, f"{100 * part:.0f}", ha="center", va="center", fontsize=8.5,
                color="#111111",
                bbox={"boxstyle": "round,pad=0.15", "facecolor": "#ffffffcc", "linewidth": 0},
            )  # fmt: skip
        begin += part
