"""Fields of recorded messages over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from observation.picture import style

Series = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""By name: simulated s, and values."""


def write(series: Series, label: str, path: Path) -> None:
    """One line for each name, as a PNG or SVG file; `label` says what the values are."""
    with style.applied(style.LOOK):
        figure = style.new_figure(8.0, 3.5)
        axes = figure.add_subplot()
        for index, (name, (seconds, values)) in enumerate(series.items()):
            axes.plot(seconds, values, color=style.colour(index), linewidth=1.0, label=name)
        axes.set_xlabel("simulated time, s")
        axes.set_ylabel(label)
        if len(series) <= 16:
            axes.legend(frameon=False, fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        style.save(figure, path)
