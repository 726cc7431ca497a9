"""Several runs beside one another in one viewer, at the same instant: a run and its branches."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from acrc_testbed.run_model.data import RunData
from acrc_testbed.view.command import opened, rest, so_far
from acrc_testbed.view.drawn import Say, Wishes, all_drawn, compute, place
from acrc_testbed.view.painting import Painting, arrangement, looked_into
from actors.observer import viewer
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.layout import Arrangement, Sheet
from actors.processes.launch import scratch_folder
from actors.runtime import regular_file
from actors.runtime.isolation.sandbox import choose, warn

FILE_NAME = "beside.rrd"


def save(folders: Sequence[Path], wishes: Wishes, path: Path, say: Say) -> bool:
    """Draw the runs into a view file; return whether it has everything, as all these functions do."""
    return _draw([so_far(folder, say) for folder in folders], path, wishes, None, say)


def picture(folders: Sequence[Path], wishes: Wishes, path: Path, second: float | None, say: Say) -> bool:
    """Draw the runs, and take a picture of the window at an instant, s; None: half-way through."""
    stories = [so_far(folder, say) for folder in folders]
    with scratch_folder() as folder:
        view = folder / FILE_NAME
        complete = _draw(stories, view, wishes, None, say)
        shot = viewer.take(view, _end(stories) / 2 if second is None else second)
    regular_file.write(path, shot.png)
    say(str(path))
    return complete


def show(folders: Sequence[Path], wishes: Wishes, say: Say) -> bool:
    """Draw the runs into a file in the folder of the first, and show it while that happens."""
    stories, path = [so_far(folder, say) for folder in folders], place(folders[0], FILE_NAME)
    shown = opened(say)
    try:
        complete = _draw(stories, path, wishes, None if shown is None else shown.address, say)
        rest(shown, path, say)
    finally:
        viewer.end(shown)
    return complete


def _draw(stories: Sequence[RunData], path: Path, wishes: Wishes, send_to: str | None, say: Say) -> bool:
    """Draw into `path`, which takes its name once it is whole, and to a viewer; return as `all_drawn`."""
    began, end = time.monotonic(), _end(stories)
    detailed = [looked_into(run.robots, wishes.robots) for run in stories]
    arranged = [
        _arranged(run, robots, number, end)
        for number, (run, robots) in enumerate(zip(stories, detailed, strict=True), 1)
    ]
    name = " beside ".join(one.name for one in arranged)
    with regular_file.replaced(path) as part, Sheet(part, arranged, name=name, send_to=send_to) as sheet:
        paintings = [
            Painting(Canvas(sheet.recording, run.robots, what.root), run, robots)
            for run, what, robots in zip(stories, arranged, detailed, strict=True)
        ]
        for run, painting in zip(stories, paintings, strict=True):
            painting.recorded(run)
        sheet.flush()
        say(f"first picture after {time.monotonic() - began:.1f} s: what was recorded")
        choice = choose(wishes.isolate)
        warn(choice.warning)
        faults = [
            f"{run.out.name}: {fault}"
            for run, painting in zip(stories, paintings, strict=True)
            for fault in compute(run, painting, sheet, permit=wishes.permit, isolate=choice.isolate)
        ]
    return all_drawn(faults, f"after {time.monotonic() - began:.1f} s", say)


def _arranged(run: RunData, robots: Sequence[str], number: int, end: float) -> Arrangement:
    """All have the time of the longest, so that lanes and plots stand below one another."""
    return replace(arrangement(run, robots), root=f"/{number}", name=run.out.name, end=end)


def _end(stories: Sequence[RunData]) -> float:
    return max(run.end for run in stories)
