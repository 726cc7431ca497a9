"""Behaviours that lay traps for whoever opens their robot's files, or writes into them, by entry string."""

from contextlib import suppress
from pathlib import Path

import msgspec

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.runtime import process
from actors.runtime.shell import Shell
from cleaning.strategies.none import behaviour as baseline


class Intruder:
    """Follows the baseline; as r1 it lays links where the logs and recordings of its next process will be."""

    def __init__(self, start: Start) -> None:
        self._lays = start.robot == "r1" and start.epoch == 0
        self._inner = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
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
    return Intruder(start)


def forges(start: Start) -> Behaviour:
    """Entry `tests.swarm.intruder:forges`: r1 says of itself what is not true, in its last record."""
    if start.robot == "r1":
        honest = process.final_note

        def boast(shell: Shell, part: process.ActorProcess, cpu_s: float) -> process.FinalNote:
            final = honest(shell, part, cpu_s)
            digest = msgspec.structs.replace(final.digest, sha256="0" * 64)
            return msgspec.structs.replace(
                final, digest=digest, published=10**9, sent={"swarm/up/r1/drive": 10**9}
            )

        process.final_note = boast
    return baseline(start)
