"""A run drawn into a view file: at once what was recorded, then, as it is computed, what was not."""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from acrc_testbed.accounting.account import spells
from acrc_testbed.accounting.time_spent import BY_ROBOTS, Cause
from acrc_testbed.explanation.explain import Explainer, ExplanationError
from acrc_testbed.results.seal import elsewhere, where
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.introspection import RecordedProcess
from acrc_testbed.run_model.recorded import NO_FRAMES
from acrc_testbed.run_model.simulated import read_run
from acrc_testbed.trace.traces import traces
from acrc_testbed.view.painting import Painting, arrangement, looked_into
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.layout import Sheet
from actors.observer.drawing.words import DrawnEvent, Occupation
from actors.processes.kernels import compile_kernels
from actors.robot.behaviour.foreign import INSTALLED, Permit
from actors.runtime import regular_file
from actors.runtime.isolation.sandbox import choose, warn

FILE_NAME: Final = "view.rrd"
SEEN_FROM_OUTSIDE: Final = {
    **dict.fromkeys(
        (*BY_ROBOTS, Cause.ON_PURPOSE, Cause.CLOSED_DOOR, Cause.UNREACHABLE, Cause.NO_PROGRESS), "standing"
    ),
    **dict.fromkeys((Cause.LOST, Cause.NO_PLAN, Cause.LIVELOCK, Cause.DRIVING), "driving"),
    **dict.fromkeys((Cause.IDLE, Cause.STRATEGY_IDLE), "idle"),
    Cause.OFF: "off",
    Cause.FROZEN: "frozen",
}
"""What a robot seems to be about, seen from outside."""
Say = Callable[[str], None]


def say_at_once(sentence: str) -> None:
    """Say it on standard output, also where that is a file that somebody follows."""
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


@dataclass(frozen=True)
class Wishes:
    """What somebody wants to see."""

    robots: Sequence[str] = ()
    """Of these everything is drawn; none named: of the first DETAILED."""
    permit: Permit = INSTALLED
    """What code may be executed that is not installed."""
    isolate: bool | None = None
    """Shut that code off; None: where the machine can."""
    why: bool = False
    """Tell why those robots decided what they did."""


def draw(
    run: RunData, path: Path, wishes: Wishes, *, send_to: str | None, say: Say, began: float | None = None
) -> bool:
    """Draw into `path`, and to a viewer; `say` is told how it gets on. AcrcError if it cannot be written.

    Return as `all_drawn` does. The file takes its name once it is whole. `began`: when the user began to
    wait, by the monotonic clock.
    """
    began = time.monotonic() if began is None else began
    with regular_file.replaced(path) as part:
        faults, lost = _draw(run, part, wishes, send_to, lambda: time.monotonic() - began, say)
    away = bool(elsewhere(run.out))
    inside = "" if away else f", with what {_told(run)} perceived and meant"
    complete = all_drawn(faults, f"after {time.monotonic() - began:.1f} s", say, inside)
    if lost:
        say(f"the viewer was closed before that: the whole view is in {path}")
    return complete or away


def all_drawn(faults: Sequence[str], taken: str, say: Say, inside: str = "") -> bool:
    """Say what could not be computed, or that all was drawn, and return whether it was."""
    for fault in faults:
        say(fault)
    say(f"drawn {taken}, without what is named above" if faults else f"all of it {taken}{inside}")
    return not faults


def _draw(
    run: RunData, path: Path, wishes: Wishes, send_to: str | None, taken: Callable[[], float], say: Say
) -> tuple[list[str], bool]:
    """Draw into `path`; what could not be computed, and whether the viewer is gone. `taken`: so far, s."""
    detailed = looked_into(run.robots, wishes.robots)
    arranged = arrangement(run, detailed, reasons=wishes.why and run.description.has_truth)
    with Sheet(path, arranged, name=run.description.title, send_to=send_to) as sheet:
        painting = Painting(Canvas(sheet.recording, run.robots), run, detailed)
        painting.recorded(run)
        sheet.flush()
        say(f"first picture after {taken():.1f} s: what was recorded")
        choice = choose(wishes.isolate)
        warn(choice.warning)
        faults = compute(run, painting, sheet, permit=wishes.permit, isolate=choice.isolate)
        if arranged.reasons:
            faults += _reason(run, painting, detailed, permit=wishes.permit, isolate=choice.isolate)
    return faults, sheet.lost


def _told(run: RunData) -> str:
    return "1 robot" if len(run.robots) == 1 else f"{len(run.robots)} robots"


def compute(run: RunData, painting: Painting, sheet: Sheet, *, permit: Permit, isolate: bool) -> list[str]:
    """Draw the traces of radio and robots; what could not be traced, in sentences."""
    faults = []
    compile_kernels()
    if run.description.has_truth:
        if run.description.records_frames:
            painting.copies(run.copies, run.end)
        else:
            faults.append(NO_FRAMES)
        sheet.flush()
    if left := elsewhere(run.out):
        return [*faults, where(run.out, left)]
    if run.description.has_truth and (run.out / "run.json").is_file():
        painting.deadlocks(deadlocks(run))
    sources = {source.actor: source for source in run.processes}
    for traced in traces(run.out, list(sources), permit=permit, isolate=isolate):
        source = sources[traced.actor]
        for number, part in enumerate(traced.parts, 1):
            painting.inside(source, part, run.end if number == len(traced.parts) else None)
        if not traced.parts:
            fault = traced.fault or "it could not be replayed"
            painting.outside(source.robot, _seen(run, source), run.end)
            painting.tell([DrawnEvent(0.0, source.robot, fault.removeprefix(f"{source.robot}: "), "WARN")])
            faults.append(fault)
        sheet.flush()
    painting.ensembles()
    painting.end(run.end)
    return faults


def _reason(
    run: RunData, painting: Painting, robots: Sequence[str], *, permit: Permit, isolate: bool
) -> list[str]:
    """Explain what robots decided; what could not be, in sentences."""
    faults, explainer = [], Explainer(run.out, permit=permit, isolate=isolate)
    for robot in robots:
        try:
            painting.reasons(robot, list(explainer.every(robot)))
        except ExplanationError as error:
            faults.append(str(error))
    return faults


def deadlocks(run: RunData) -> dict[str, list[tuple[float, float]]]:
    """By robot when it was in a deadlock, s."""
    found: dict[str, list[tuple[float, float]]] = {robot: [] for robot in run.robots}
    for one in spells(read_run(run.out)):
        if one.cause is Cause.DEADLOCK:
            found[one.robot].append((one.begin, one.end))
    return found


def _seen(run: RunData, source: RecordedProcess) -> list[Occupation]:
    """What a robot did, by ground truth alone."""
    if not run.description.has_truth:
        return []
    found = spells(read_run(run.out))
    return [Occupation(one.begin, SEEN_FROM_OUTSIDE[one.cause]) for one in found if one.robot == source.robot]


def place(out: Path, name: str = FILE_NAME) -> Path:
    """Where the view of a run goes: into its folder; among temporary files where nobody may write there."""
    if os.access(out, os.W_OK):
        return out / name
    return Path(tempfile.mkdtemp(prefix="acrc-view-")) / name
