"""What every robot did when: a lane each, with the places that it cleaned and took over."""

from collections.abc import Sequence
from typing import Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from observation.accounting.spells import Spell
from observation.accounting.time_spent import Cause
from observation.evidence.run_evidence import RunEvidence
from observation.evidence.said_places import Deed
from observation.picture import style

_HALF: Final = 0.38
"""Half the height of a lane, of which there is one per unit."""


def draw(axes: Axes, run: RunEvidence, doing: Sequence[Spell], *, legend: bool) -> None:
    """Ticks: a place cleaned, in its owner's colour; triangles: one taken over."""
    for one in doing:
        extent = [(one.begin, one.end - one.begin)], (run.robots.index(one.robot) - _HALF, 2 * _HALF)
        axes.broken_barh(*extent, facecolors=style.CAUSES[one.cause], lw=0)
    if style.few(run.robots):
        for deed in run.reported:
            _mark(axes, run, deed, "|", 0.0, 9.0, 1.6)
        for deed in run.taken_over:
            _mark(axes, run, deed, "v", -_HALF, 5.0, 0.5)
        axes.set_yticks(range(len(run.robots)), run.robots)
        for index, label in enumerate(axes.get_yticklabels()):
            label.set_color(style.colour(index))
            label.set_fontweight("bold")
    else:
        axes.set_ylabel("robots")
    axes.set_ylim(len(run.robots) - 0.4, -0.7)
    axes.set_xlim(0.0, run.end)
    if legend:
        marks = _marks() if style.few(run.robots) else []
        axes.legend(
            handles=[*_kinds(doing), *marks], ncols=7, fontsize=7, frameon=False, handlelength=1.2,
            columnspacing=1.0, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        )  # fmt: skip


def key(doing: Sequence[Spell]) -> list[Artist]:
    """What the colours and marks mean that there are."""
    return [*_kinds(doing), *_marks()]


def _mark(
    axes: Axes, run: RunEvidence, deed: Deed, marker: str, shift: float, size: float, edge: float
) -> None:
    if deed.robot not in run.robots:
        return
    owner = run.robots.index(deed.place.owner) if deed.place.owner in run.robots else 0
    row, colour = run.robots.index(deed.robot) + shift, style.colour(owner)
    axes.plot(deed.second, row, marker=marker, ms=size, mec=colour, mfc=colour, mew=edge)


def _kinds(doing: Sequence[Spell]) -> list[Artist]:
    seen = {one.cause for one in doing}
    return [Patch(color=style.CAUSES[kind], label=kind.value) for kind in Cause if kind in seen]


def _marks() -> list[Artist]:
    return [
        Line2D([], [], marker="|", ls="", ms=9, mew=1.6, color=style.INK, label="cleaned a place"),
        Line2D([], [], marker="v", ls="", ms=5, color=style.INK, label="took a place over"),
    ]
