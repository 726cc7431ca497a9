"""What every robot did when: a lane each, with the places that it cleaned and took over, and orders."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from acrc_testbed.accounting.account import Spell
from acrc_testbed.accounting.time_spent import Cause
from acrc_testbed.picture import marks, style
from acrc_testbed.run_model.data import PlaceEvent, RunData
from acrc_testbed.run_model.events import ordered_changes
from actors.observer.glyphs import MARKS, PUT, SEEN_STATES, WHITE, StateGlyph, contrast, hexadecimal

_HALF: Final = 0.38
"""Half the height of a lane, of which there is one per unit."""
_WELL: Final = frozenset({Cause.DRIVING, Cause.IDLE})
ORDERED: Final = "something was ordered"


def draw(axes: Axes, run: RunData, doing: Sequence[Spell], *, legend: bool) -> None:
    """Ticks: a place cleaned, in its owner's colour; triangles: one taken over; dashed: an order."""
    few = style.few(run.robots)
    rows = {robot: row for row, robot in enumerate(order(run, doing))}
    for one in doing:
        extent = [(one.begin, one.end - one.begin)], (rows[one.robot] - _HALF, 2 * _HALF)
        axes.broken_barh(*extent, **look_of(SEEN_STATES[one.cause.value]))
    for deed in run.reported:
        _mark(axes, run, deed, rows, "cleaned", 0.0, 9.0 if few else 3.0)
    for deed in run.taken_over:
        _mark(axes, run, deed, rows, "took over", -_HALF, 5.0 if few else 2.0)
    for change in ordered_changes(run):
        axes.axvline(change.second, color=hexadecimal(PUT), ls="--", lw=0.8, zorder=3)
    axes.set_yticks(range(len(rows)), list(rows), fontsize=8.5 if few else 6.0)
    for label, robot in zip(axes.get_yticklabels(), rows, strict=True):
        label.set_color(style.colour(run.robots.index(robot)))
        label.set_fontweight("bold")
    axes.set_ylim(len(rows) - 0.4, -0.7)
    axes.set_xlim(0.0, run.end)
    if legend:
        axes.legend(
            handles=key([run], doing), ncols=5, fontsize=7, frameon=False, handlelength=1.6,
            columnspacing=1.0, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        )  # fmt: skip


def order(run: RunData, doing: Sequence[Spell]) -> list[str]:
    """The robots from above: a few as they are, many by how long something kept them, the longest first."""
    if style.few(run.robots):
        return list(run.robots)
    kept: defaultdict[str, float] = defaultdict(float)
    for one in doing:
        kept[one.robot] += 0.0 if one.cause in _WELL else one.end - one.begin
    return sorted(run.robots, key=lambda robot: -kept[robot])


def key(runs: Sequence[RunData], doing: Sequence[Spell]) -> list[Artist]:
    """What the colours and marks mean that there are."""
    seen = {one.cause.value for one in doing}
    states = [(word, glyph) for word, glyph in SEEN_STATES.items() if word in seen]
    kinds: list[Artist] = [Patch(label=word, **look_of(glyph)) for word, glyph in states]
    used = [
        name
        for name, deeds in (
            ("cleaned", [run.reported for run in runs]), ("took over", [run.taken_over for run in runs]),
        )
        if any(deeds)
    ]  # fmt: skip
    kinds += [marks.sample(name) for name in used]
    if any(ordered_changes(run) for run in runs):
        kinds.append(Line2D([], [], color=hexadecimal(PUT), ls="--", lw=0.8, label=ORDERED))
    return kinds


def look_of(glyph: StateGlyph) -> dict[str, Any]:
    """Colour, and a hatch that can be seen on it."""
    ink = "#ffffff" if contrast(glyph.colour, WHITE) > 3.0 else style.INK
    colour = hexadecimal(glyph.colour)
    edge = ink if glyph.hatch else colour
    return {"facecolor": colour, "edgecolor": edge, "hatch": glyph.hatch, "lw": 0}


def _mark(
    axes: Axes, run: RunData, deed: PlaceEvent, rows: dict[str, int], name: str, shift: float, size: float
) -> None:
    if deed.robot in rows:
        owner = run.robots.index(deed.place.owner) if deed.place.owner in run.robots else 0
        marks.plot(axes, name, deed.second, rows[deed.robot] + shift, style.colour(owner), size=size)
        if MARKS[name].shape == "tick":  # a robot's colour may be that of what it did
            axes.lines[-1].set_path_effects(style.HALO)
