"""A strategy that drives nowhere in a run, and does as `mood` in the run's folder says afterwards."""

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from actors.instant import Instant
from actors.robot.behaviour.ports import Decision, Start, View


def _mood() -> str:
    """Only in a program that executes the recording: it is told the run's folder."""
    if "--answer" not in sys.argv:
        return ""
    mood = Path(sys.argv[sys.argv.index("--out") + 1]) / "mood"
    return mood.read_text() if mood.exists() else ""


def _answer(data: bytes) -> None:
    """Say something in place of the program, which has the file open."""
    for descriptor in range(3, 40):
        with suppress(OSError):
            os.write(descriptor, data)
    os._exit(0)


def _leave() -> None:
    if os.fork() == 0:
        time.sleep(1000)
    os._exit(3)


def _flood() -> None:
    while os.write(1, b"\x1b[2J flood " * 100_000):
        pass


def _peek() -> None:
    found = [path.name for path in Path(__file__).parents[2].iterdir()]
    raise RuntimeError(f"sees {'deploy' in found} {os.access('/etc/hostname', os.W_OK)}")


MOODS: dict[str, Callable[[], object]] = {
    "": lambda: None,
    "hang": lambda: time.sleep(1000),
    "leave": _leave,
    "flood": _flood,
    "peek": _peek,
    "much": lambda: _answer(bytes(2000)),
}


class Hostile:
    """Does nothing in a run."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Nothing, or what the mood says."""
        MOODS[_mood()]()
        return Decision()


def behaviour(start: Start) -> Hostile:
    """The strategy."""
    return Hostile()
