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
from actors.task.task import Value

_FEW_ROWS: Final = 25
"""Number of rows from which tables are collapsed."""
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
    intervals, task = cause_intervals(run), run.description.task
    alt = (
        f"Floor plan with robots' trails, {task.items} and positions of blocked robots; below, each robot's "
        f"activity, radio frames per second, and {task.items} {task.done} over time. The tables contain the "
        "same data."
    )
    candidates = [
        PageSection("Result", list(_result_sentences(run))),
        PageSection("Overview", picture=PagePicture(drawn, alt, _CAPTION)),
        PageSection("Time of each robot", tables=[_time_table(run, intervals)]),
        PageSection("Blocked robots", tables=[_blocked_table(intervals)]),
        PageSection("Events and orders", tables=[_event_table(run, intervals)]),
        PageSection("Decisions", tables=[_decision_table(run)]),
        PageSection(task.items.capitalize(), tables=[_item_table(run)]),
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
    """Return seconds by cause, and numbers of events, per robot."""
    task = run.description.task
    events = {kind: [one.robot for one in run.task_events if one.kind == kind] for kind in task.events}
    events |= {"taken over": [one.robot for one in run.taken_over]}
    events |= {"given up": [one.robot for one in run.given_up]}
    durations: defaultdict[tuple[str, str], float] = defaultdict(float)
    for one in intervals:
        durations[one.robot, one.cause] += one.end - one.begin
    kinds = [kind for kind in (*Cause, *task.causes) if any(durations[robot, kind] for robot in run.robots)]
    rows = [
        [
            robot,
            *(f"{durations[robot, kind]:.1f}" for kind in kinds),
            *(str(robots.count(robot)) for robots in events.values()),
        ]
        for robot in run.robots
    ]
    columns = ["robot", *(f"{kind}, s" for kind in kinds), *events]
    return _table(
        f"Seconds by cause, and numbers of {task.items}, per robot.", columns, rows, range(1, len(columns))
    )


def _blocked_table(intervals: Sequence[CauseInterval]) -> PageTable:
    rows = [
        [f"{x:.2f}", f"{y:.2f}", f"{lasted:.1f}"]
        for x, y, lasted in sorted(floor_picture.blocked_positions(intervals), key=lambda one: -one[2])
    ]
    return _table("Positions where robots waited for others, with total duration.",
                  ["x, m", "y, m", "duration, s"], rows, range(3))  # fmt: skip


def _event_table(run: RunData, intervals: Sequence[CauseInterval]) -> PageTable:
    """Return the orders, and the intervals of frozen and stopped robots."""
    stopped = [one for one in intervals if one.cause in (Cause.FROZEN, Cause.OFF)]
    events = [(one.second, one.robot, one.words) for one in ordered_changes(run)]
    events += [(one.begin, one.robot, f"is {one.cause} until {one.end:g} s") for one in stopped]
    rows = [[f"{second:.1f}", robot, words] for second, robot, words in sorted(events)]
    return _table("Events and orders.", ["time, s", "robot", "event"], rows, (0,))


def _decision_table(run: RunData) -> PageTable:
    """Return the decisions in the robots' final records."""
    decisions = [(one, robot) for robot, report in run.reports.items() for one in report.decisions]
    rows = [
        [f"{in_seconds(one.instant):.1f}", robot, one.words, one.by, one.source, f"{one.age / 1e6:.2f}"]
        for one, robot in sorted(decisions, key=lambda pair: (pair[0].instant, pair[1]))
    ]
    columns = ["time, s", "robot", "decision", "by", "knowledge of", "age, s"]
    caption = "Decisions of the adaptation. For their causes, run `acrc explain OUT ROBOT@S`."
    return _table(caption, columns, rows, (0, 5))


def _item_table(run: RunData) -> PageTable:
    """Return the final state of all items, by the columns that the task declares."""
    task = run.description.task
    rows = [[_cell(row.get(column.name)) for column in task.columns] for row in run.items]
    columns = [column.name.replace("_", " ") for column in task.columns]
    numbers = [index for index, column in enumerate(task.columns) if column.type in ("integer", "number")]
    return _table(f"All {task.items}.", columns, rows, numbers)


def _cell(value: Value) -> str:
    return "" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value)


def _radio_table(run: RunData) -> PageTable:
    counts = {} if run.result is None else run.result.frames
    rows = [[name.replace("_", " "), str(count)] for name, count in counts.items() if count]
    return _table("Outcomes of frames, and of each frame at each other robot.", ["", "count"], rows, (1,))


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
    numbers: Sequence[int],
) -> PageTable:
    """Return a table; `numbers`: indices of numeric columns."""
    numeric = [index in numbers for index in range(len(columns))]
    return PageTable(caption, columns, rows, numeric, folded=len(rows) > _FEW_ROWS)
