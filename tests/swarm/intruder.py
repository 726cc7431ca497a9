"""A behaviour that lays traps for whoever opens files in its robot's folder, by entry string."""

from contextlib import suppress
from pathlib import Path

from actors.instant import Instant, seconds
from actors.robot.ports import Behaviour, Decision, Start, View
from cleaning.baseline import behaviour as baseline


class Intruder:
    """Follows the baseline; as r1 it lays links where the logs and recordings of its next process will be."""

    def __init__(self, start: Start) -> None:
        self._lays = start.robot == "r1" and start.epoch == 0
        self._inner = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline."""
        if self._lays and view.instant >= seconds(1):
            self._lays = False
            own = Path.cwd()
            (own / "diary.txt").write_text("what is mine")
            for folder in (own, own.parent):
                for name in ("r1.1.log", "r1.1.mcap", "world.mcap"):
                    with suppress(OSError):
                        (folder / name).symlink_to("../../victim.txt")
                with suppress(OSError):
                    (folder / "r1.mcap").rename(folder / "old.mcap")
        return self._inner.advance(view, until)


def behaviour(start: Start) -> Behaviour:
    """Entry `tests.swarm.intruder:behaviour`."""
    return Intruder(start)
