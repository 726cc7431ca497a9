"""A strategy that is idle in a run and, when replayed, attacks as the file `mood` in the folder says."""

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from actors.instant import Instant
from actors.robot.behaviour.ports import Decision, Start, View


def _mood() -> str:
    """Return the mood; empty unless a recording is replayed."""
    if "--answer" not in sys.argv:
        return ""
    mood = Path(sys.argv[sys.argv.index("--out") + 1]) / "mood"
    return mood.read_text() if mood.exists() else ""


def _answer(data: bytes) -> None:
    """Write a forged answer into the program's open file."""
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
    """Behaviour that is idle during a run."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Do nothing, or what the mood says."""
        MOODS[_mood()]()
        return Decision()


def behaviour(start: Start) -> Hostile:
    """Return the strategy's behaviour."""
    return Hostile()
