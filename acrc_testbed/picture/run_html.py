"""A run on one HTML page: its result in sentences, the picture, and tables of the numbers behind it."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from acrc_testbed.explanation.account import Spell, spells
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.picture import floor_picture, run_page, style
from acrc_testbed.picture import html_page as rendering
from acrc_testbed.picture.html_page import PagePicture, PageSection, PageTable
from acrc_testbed.recordings.topics import goes_on
from acrc_testbed.results import summary
from acrc_testbed.run_model.data import RunData, ordered_changes
from actors.instant import in_seconds
from actors.runtime import regular_file
from actors.task.referee import PlaceOutcome

_FEW_ROWS: Final = 25
"""Longer tables are folded."""
_ALT: Final = (
    "The floor plan with the way of each robot, places and where robots stood near each other; below, what "
    "each robot did when, radio frames per second, and places cleaned over time. The tables say the same."
)
_CAPTION: Final = "Drawn from the recordings; the legend stands below the floor."


def write(run: RunData, path: Path) -> None:
    """The page as a file that needs nothing beside itself."""
    with style.applied(style.LOOK):
        drawn = style.svg(run_page.draw(run))
    regular_file.write(path, html(run, drawn).encode())


def html(run: RunData, drawn: bytes) -> str:
    """Return the page; `drawn`: the run's picture as an SVG."""
    return rendering.html(style.short_title(run), sections(run, drawn))


def sections(run: RunData, drawn: bytes) -> list[PageSection]:
    """Return the sections about a run that have any content."""
    doing = spells(run)
    every = [
        PageSection("What came of it", list(_words(run))),
        PageSection("What happened", picture=PagePicture(drawn, _ALT, _CAPTION)),
        PageSection("What each robot did", tables=[_deeds(run, doing)]),
        PageSection("Where robots stood before others", tables=[_meetings(doing)]),
        PageSection("What was put into the world", tables=[_put(run, doing)]),
        PageSection("What was decided", tables=[_decided(run)]),
        PageSection("Places", tables=[_places(run.outcomes)]),
        PageSection("Radio", tables=[_radio(run)]),
        PageSection("How to make it again", list(_origin(run))),
    ]
    return [one for one in every if not one.is_empty]


def _words(run: RunData) -> Iterator[str]:
    if run.result is None:
        how = "is going on" if goes_on(run.out) else "was cut off"
        yield f"The run {how}; this is what was recorded in its first {run.end:g} simulated s."
    else:
        yield from summary.sentences(run.result)


def _deeds(run: RunData, doing: Sequence[Spell]) -> PageTable:
    """Seconds by what a robot did, and what it did with places."""
    lasted: defaultdict[tuple[str, Cause], float] = defaultdict(float)
    for one in doing:
        lasted[one.robot, one.cause] += one.end - one.begin
    kinds = [kind for kind in Cause if any(lasted[robot, kind] for robot in run.robots)]
    rows = [
        [
            robot,
            *(f"{lasted[robot, kind]:.1f}" for kind in kinds),
            *(
                str(sum(deed.robot == robot for deed in deeds))
                for deeds in (run.reported, run.taken_over, run.given_up)
            ),
        ]
        for robot in run.robots
    ]
    columns = ["robot", *(f"{kind.value}, s" for kind in kinds), "cleaned", "taken over", "given up"]
    return _table("Seconds by what each robot did, and how many places it reported.", columns, rows, 1)


def _meetings(doing: Sequence[Spell]) -> PageTable:
    rows = [
        [f"{x:.2f}", f"{y:.2f}", f"{lasted:.1f}"]
        for x, y, lasted in sorted(floor_picture.meetings(doing), key=lambda one: -one[2])
    ]
    return _table("Where, m, and how long in all.", ["x", "y", "s"], rows, 0)


def _put(run: RunData, doing: Sequence[Spell]) -> PageTable:
    """What was ordered, and which robots were frozen or off."""
    stopped = [one for one in doing if one.cause in (Cause.FROZEN, Cause.OFF)]
    told = [(one.second, one.robot, one.words) for one in ordered_changes(run)]
    told += [(one.begin, one.robot, f"is {one.cause.value} until {one.end:g} s") for one in stopped]
    rows = [[f"{second:.1f}", robot, words] for second, robot, words in sorted(told)]
    return _table("By the scenario's events, and by orders.", ["s", "robot", "what"], rows, -1, numbers=(0,))


def _decided(run: RunData) -> PageTable:
    """What the robots' adaptations decided, by their last records."""
    made = [(one, robot) for robot, report in run.reports.items() for one in report.decisions]
    rows = [
        [f"{in_seconds(one.instant):.1f}", robot, one.words, one.by, one.source, f"{one.age / 1e6:.2f}"]
        for one, robot in sorted(made, key=lambda pair: (pair[0].instant, pair[1]))
    ]
    columns = ["s", "robot", "decision", "by", "from what it knew of", "as old as, s"]
    caption = "Decisions of the adaptation. Why, says `acrc explain OUT ROBOT@S`; OUT is the run's folder."
    return _table(caption, columns, rows, -1, numbers=(0, 5))


def _places(places: Sequence[PlaceOutcome]) -> PageTable:
    def second(instant: int | None) -> str:
        return "" if instant is None else f"{instant / 1e6:.1f}"

    rows = [
        [
            f"{one.owner}/{one.place}", f"{one.x:.2f}", f"{one.y:.2f}", one.verdict.value.replace("_", " "),
            one.reported_by or "", second(one.reported_at), second(one.reached_at),
        ]
        for one in places
    ]  # fmt: skip
    columns = ["place", "x, m", "y, m", "what became of it", "reported by", "reported, s", "reached, s"]
    return _table("Every place.", columns, rows, -1, numbers=(1, 2, 5, 6))


def _radio(run: RunData) -> PageTable:
    counts = {} if run.result is None else run.result.frames
    rows = [[name.replace("_", " "), str(count)] for name, count in counts.items() if count]
    return _table("What became of frames, and of each frame at each other robot.", ["", "count"], rows, 1)


def _origin(run: RunData) -> Iterator[str]:
    result = run.result
    if result is None:
        return
    origin = result.origin
    what = f"Scenario {origin.scenario}, strategy {origin.strategy}, seed {result.seed}"
    yield f"{what}, commit {origin.commit}: digest {result.digest}."
    yield "acrc replay OUT, OUT being the run's folder, makes it again and compares every message."


def _table(
    caption: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    first: int,
    numbers: Sequence[int] = (),
) -> PageTable:
    """A table whose columns from `first` on hold numbers, or, if that is negative, those in `numbers`."""
    numeric = [place >= first if first >= 0 else place in numbers for place in range(len(columns))]
    return PageTable(caption, columns, rows, numeric, folded=len(rows) > _FEW_ROWS)
