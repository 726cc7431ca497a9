"""What strategies have printed: lines of robots' logs as keys `r1/log`, also while the run goes on."""

import json
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from actors.processes.robot_logs import LogTail, check_names, robots
from observation.recordings.lines import LineForm, row
from observation.recordings.topics import TopicError, has_ended

_LOG: Final = "/log"
_POLL_S: Final = 0.1
_STAMP: Final = re.compile(r" *(\d+\.\d{3}) s  step \d+  ")


class Printed(NamedTuple):
    """A line of a robot's log."""

    robot: str
    seconds: float
    """Simulated; of a line without a time that of the line before it."""
    line: str


def is_log(key: str) -> bool:
    """True for the key of a log: `r1/log`, `*/log`."""
    return key.endswith(_LOG)


def read(
    out: Path, keys: Sequence[str], begin: float, end: float | None, *, follow: bool
) -> Iterator[Printed]:
    """Every line of these logs; with `follow` also what is added, to the run's end. Raises LogError."""
    if out.is_file():
        raise TopicError(f"{out}: a recording, which has no log; must be a run's folder")
    wanted = [key.removesuffix(_LOG) for key in keys]
    check_names(wanted, robots(out), str(out))
    tail, now = LogTail(out, wanted), dict[str, float]()
    while follow and not has_ended(out):
        yield from _within(tail.poll(), now, begin, end)
        time.sleep(_POLL_S)
    yield from _within(tail.close(), now, begin, end)


def _within(
    found: Iterable[tuple[str, str]], now: dict[str, float], begin: float, end: float | None
) -> Iterator[Printed]:
    for robot, line in found:
        if stamp := _STAMP.match(line):
            now[robot] = float(stamp[1])
        seconds = now.setdefault(robot, 0.0)
        if begin <= seconds and (end is None or seconds <= end):
            yield Printed(robot, seconds, line)


def shown(found: Iterable[Printed], form: LineForm, *, named: bool) -> Iterator[str]:
    """Lines as they are printed; `named`: with the robot in front."""
    if form is LineForm.CSV:
        yield row(["seconds", "key", "text"])
    for one in found:
        text = _STAMP.sub("", one.line, count=1)
        if form is LineForm.JSON:
            yield json.dumps({"seconds": one.seconds, "key": one.robot + _LOG, "text": text})
        elif form is LineForm.CSV:
            yield row([one.seconds, one.robot + _LOG, text])
        else:
            yield f"{one.robot}  {one.line}" if named else one.line
