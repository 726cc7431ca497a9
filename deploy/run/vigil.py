"""Looks whether a run gets on, and finds out who keeps it from that."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from actors.messages import Progress
from actors.processes.last_word import where_it_stands
from actors.processes.launch import Child
from actors.processes.silence import WORLD, HoldUp, Silence, SilenceVerdict, Suspect, Telling, Timeout
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.process_table import ProcessGlance


def on_host(children: Iterable[Child], actor: str) -> str:
    """On which host it is, to stand behind what is said of it; empty: on this computer."""
    host = next((child.host for child in children if child.program.actor == actor), "")
    return f" (on host {host})" if host else ""


class Vigil:
    """What one run's processes are seen to do while no step is taken."""

    def __init__(
        self,
        timeout: Timeout,
        wait: Callable[[float], None],
        say: Callable[[str], None],
        table: Callable[[], Mapping[int, ProcessGlance]] = process_table.table,
        queued_s: Callable[[int], float | None] = process_table.queued_s,
    ) -> None:
        """`wait` passes so many seconds; `say` is told a sentence for the person at the terminal.

        `table` and `queued_s`: what is known of the run's processes, as of `process_table`.
        """
        self._silence = Silence(timeout, look=table, queued=queued_s)
        self._ends = Silence(timeout, look=table, queued=queued_s)
        self._wait = wait
        self._say = say
        self._size = -1
        self._waiting: Progress | None = None
        self._paused = False
        self._told: frozenset[str] = frozenset()
        self._telling = Telling(self._silence, say)

    @property
    def held_up(self) -> dict[str, HoldUp]:
        """Who has held up steps so far."""
        return self._silence.held_up

    def hear(self, progress: Progress) -> None:
        """Take in what the world says of itself."""
        self._paused = progress.paused
        self._waiting = progress if progress.awaits else None

    def look(self, running: Sequence[Child], recording: Path) -> str | None:
        """A sentence on who keeps the run from its next step for too long; None while all is well."""
        size = recording.stat().st_size if recording.is_file() else 0
        if size != self._size or self._paused:
            self._size = size
            self._waiting = None
            self._silence.broken()
            self._tell(frozenset())
            self._telling.broken()
            return None
        waiting = self._waiting
        if waiting is None:  # it says nothing, so it is to blame itself
            return self._ask(running, ("world",), WORLD, starting=not size)
        return self._ask(running, waiting.awaited or ("world",), waiting.awaits, starting=waiting.starting)

    def look_for_ends(self, running: Sequence[Child], what: str) -> str | None:
        """A sentence on who does not end for too long, although nothing is left to be done."""
        everyone = [Suspect(child.program.actor, child.pid) for child in running]
        verdict = self._ends.verdict(everyone, everyone, what)
        self._tell(self._ends.stopped)
        return None if verdict is None else self._words(verdict, running)

    def broken(self) -> None:
        """Somebody has done what was awaited."""
        self._silence.broken()
        self._ends.broken()

    def _ask(
        self, running: Sequence[Child], names: Sequence[str], what: str, starting: bool = False
    ) -> str | None:
        everyone = [Suspect(child.program.actor, child.pid) for child in running]
        awaited = [suspect for suspect in everyone if suspect.name in names]
        what += on_host(running, names[0])
        verdict = self._silence.verdict(everyone, awaited, what, starting=starting)
        self._tell(self._silence.stopped)
        if verdict is not None:
            return self._words(verdict, running)
        if not starting:
            self._telling.lasts(awaited, what)
        return None

    def _words(self, verdict: SilenceVerdict, running: Sequence[Child]) -> str:
        guilty = next(child for child in running if child.pid == verdict.suspect.pid)
        place = where_it_stands(guilty, self._wait)
        return f"{verdict.sentence}; {guilty.program.actor} stands at {place}" if place else verdict.sentence

    def _tell(self, stopped: frozenset[str]) -> None:
        if stopped != self._told:
            self._told = stopped
            if stopped:
                self._say(f"{', '.join(sorted(stopped))} stopped by a signal; the run waits for SIGCONT")
