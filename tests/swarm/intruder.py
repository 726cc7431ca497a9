"""Behaviours that attack the files of their run, for strategies by entry string."""

from contextlib import suppress
from pathlib import Path

import msgspec

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.runtime import process
from actors.runtime.shell import Shell
from cleaning.strategies.none import behaviour as baseline


class Intruder:
    """Baseline robot; r1 creates links in place of logs and recordings of its next process."""

    def __init__(self, start: Start) -> None:
        self._is_attacker = start.robot == "r1" and start.epoch == 0
        self._inner = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
        if self._is_attacker and view.instant >= seconds(1):
            self._is_attacker = False
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
    """Forge counters and digest in the final note of r1."""
    if start.robot == "r1":
        honest = process.final_note

        def forged(shell: Shell, part: process.ActorProcess, cpu_s: float) -> process.FinalNote:
            final = honest(shell, part, cpu_s)
            digest = msgspec.structs.replace(final.digest, sha256="0" * 64)
            return msgspec.structs.replace(
                final, digest=digest, published=10**9, sent={"swarm/up/r1/drive": 10**9}
            )

        process.final_note = forged
    return baseline(start)
