"""HTML page of a run: result, picture and tables."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from acrc_testbed.explanation.time_accounting import CauseInterval, cause_intervals
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.picture import floor_picture, run_page, style
from acrc_testbed.picture import html_page as rendering
from acrc_testbed.picture.html_page import PagePicture, PageSection, PageTable
from acrc_testbed.recordings.topics import is_running
from acrc_testbed.results import summary
from acrc_testbed.run_model.data import RunData, ordered_changes
from actors.instant import in_seconds
from actors.runtime import regular_file
from cleaning.referee import PlaceOutcome

_FEW_ROWS: Final = 25
"""Number of rows from which tables are collapsed."""
_ALT: Final = (
    "Floor plan with robots' trails, places and positions of blocked robots; below, each robot's activity, "
    "radio frames per second, and places cleaned over time. The tables contain the same data."
)
_CAPTION: Final = "From the recordings; legend below the floor."


def write(run: RunData, path: Path) -> None:
    """Write the page as one self-contained file."""
    with style.context(style.LOOK):
        drawn = style.svg(run_page.draw(run))
    regular_file.write_atomically(path, html(run, drawn).encode())


def html(run: RunData, drawn: bytes) -> str:
    """Return the page; `drawn`: the run's picture as an SVG."""
    return rendering.html(style.short_title(run), sections(run, drawn))


def sections(run: RunData, drawn: bytes) -> list[PageSection]:
    """Return the sections about a run that have any content."""
    intervals = cause_intervals(run)
    candidates = [
        PageSection("Result", list(_result_sentences(run))),
        PageSection("Overview", picture=PagePicture(drawn, _ALT, _CAPTION)),
        PageSection("Time of each robot", tables=[_time_table(run, intervals)]),
        PageSection("Blocked robots", tables=[_blocked_table(intervals)]),
        PageSection("Events and orders", tables=[_event_table(run, intervals)]),
        PageSection("Decisions", tables=[_decision_table(run)]),
        PageSection("Places", tables=[_place_table(run.outcomes)]),
        PageSection("Radio", tables=[_radio_table(run)]),
        PageSection("Reproduction", list(_reproduction_sentences(run))),
    ]
    return [one for one in candidates if not one.is_empty]


def _result_sentences(run: RunData) -> Iterator[str]:
    if run.result is None:
        state = "is still running" if is_running(run.out) else "was cut off"
        yield f"The run {state}; this page shows its first {run.end:g} simulated s."
    else:
        yield from summary.result_sentences(run.result)


def _time_table(run: RunData, intervals: Sequence[CauseInterval]) -> PageTable:
    """Return seconds by cause, and numbers of places, per robot."""
    durations: defaultdict[tuple[str, Cause], float] = defaultdict(float)
    for one in intervals:
        durations[one.robot, one.cause] += one.end - one.begin
    kinds = [kind for kind in Cause if any(durations[robot, kind] for robot in run.robots)]
    rows = [
        [
            robot,
            *(f"{durations[robot, kind]:.1f}" for kind in kinds),
            *(
                str(sum(event.robot == robot for event in events))
                for events in (run.reported, run.taken_over, run.given_up)
            ),
        ]
        for robot in run.robots
    ]
    columns = ["robot", *(f"{kind.value}, s" for kind in kinds), "cleaned", "taken over", "given up"]
    return _table("Seconds by cause, and numbers of places, per robot.", columns, rows, 1)


def _blocked_table(intervals: Sequence[CauseInterval]) -> PageTable:
    rows = [
        [f"{x:.2f}", f"{y:.2f}", f"{lasted:.1f}"]
        for x, y, lasted in sorted(floor_picture.blocked_positions(intervals), key=lambda one: -one[2])
    ]
    return _table("Positions where robots waited for others, with total duration.",
                  ["x, m", "y, m", "duration, s"], rows, 0)  # fmt: skip


def _event_table(run: RunData, intervals: Sequence[CauseInterval]) -> PageTable:
    """Return the orders, and the intervals of frozen and stopped robots."""
    stopped = [one for one in intervals if one.cause in (Cause.FROZEN, Cause.OFF)]
    events = [(one.second, one.robot, one.words) for one in ordered_changes(run)]
    events += [(one.begin, one.robot, f"is {one.cause.value} until {one.end:g} s") for one in stopped]
    rows = [[f"{second:.1f}", robot, words] for second, robot, words in sorted(events)]
    return _table("Events and orders.", ["time, s", "robot", "event"], rows, -1, numbers=(0,))


def _decision_table(run: RunData) -> PageTable:
    """Return the decisions in the robots' final records."""
    decisions = [(one, robot) for robot, report in run.reports.items() for one in report.decisions]
    rows = [
        [f"{in_seconds(one.instant):.1f}", robot, one.words, one.by, one.source, f"{one.age / 1e6:.2f}"]
        for one, robot in sorted(decisions, key=lambda pair: (pair[0].instant, pair[1]))
    ]
    columns = ["time, s", "robot", "decision", "by", "knowledge of", "age, s"]
    caption = "Decisions of the adaptation. For their causes, run `acrc explain OUT ROBOT@S`."
    return _table(caption, columns, rows, -1, numbers=(0, 5))


def _place_table(places: Sequence[PlaceOutcome]) -> PageTable:
    def second(instant: int | None) -> str:
        return "" if instant is None else f"{instant / 1e6:.1f}"

    rows = [
        [
            f"{one.owner}/{one.place}", f"{one.x:.2f}", f"{one.y:.2f}", one.verdict.value.replace("_", " "),
            one.reported_by or "", second(one.reported_at), second(one.reached_at),
        ]
        for one in places
    ]  # fmt: skip
    columns = ["place", "x, m", "y, m", "outcome", "reported by", "reported, s", "reached, s"]
    return _table("All places.", columns, rows, -1, numbers=(1, 2, 5, 6))


def _radio_table(run: RunData) -> PageTable:
    counts = {} if run.result is None else run.result.frames
    rows = [[name.replace("_", " "), str(count)] for name, count in counts.items() if count]
    return _table("Outcomes of frames, and of each frame at each other robot.", ["", "count"], rows, 1)


def _reproduction_sentences(run: RunData) -> Iterator[str]:
    result = run.result
    if result is None:
        return
    origin = result.origin
    what = f"Scenario {origin.scenario}, strategy {origin.strategy}, seed {result.seed}"
    yield f"{what}, commit {origin.commit}: digest {result.digest}."
    yield "To repeat the run and compare every message, run acrc replay with the run's folder."


def _table(
    caption: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    first: int,
    numbers: Sequence[int] = (),
) -> PageTable:
    """Return a table; numeric columns are those from `first` on, or `numbers` if `first` is negative."""
    numeric = [place >= first if first >= 0 else place in numbers for place in range(len(columns))]
    return PageTable(caption, columns, rows, numeric, folded=len(rows) > _FEW_ROWS)
