"""Judges a run that takes no step: who is working, who was stopped, and who keeps everybody waiting.

A process is never blamed while it has work to do and gets on with it: what counts is the time that it lets
pass without working, and the processor time that it spends on one step. So a loaded machine, a hundred robots
that start at once, and a suspended laptop change nothing; a process that somebody has stopped is waited for.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.process_table import Glance

WORLD: Final = "the world has not taken a step"


@dataclass(frozen=True)
class Timeout:
    """How long a run may take no step."""

    step_s: float = 30.0
    """Time in which the awaited process does nothing, or processor time that it spends on one step, s. Own
    choice: hundreds of times what the slowest step of a shipped strategy takes."""
    start_factor: float = 10.0
    """How many times more processor time a process may spend until it is ready; own choice: with nothing
    compiled yet, a slow computer needs two minutes for its first start."""
    working_share: float = 0.05
    """A process that used this share of one processor or more since the last look was working; own choice:
    one that looks again and again whether something has come uses less."""
    look_s: float = 0.5
    """Time between two looks; own choice. One that comes much later counts as twice this, for then this
    process itself was stopped, or got no processor."""


class Suspect(NamedTuple):
    """Somebody who is waited for."""

    name: str
    pid: int


class SilenceVerdict(NamedTuple):
    """Who is at fault, and the words for it."""

    suspect: Suspect
    sentence: str


class Silence:
    """One stretch of time without a step; begins anew with every step."""

    def __init__(
        self,
        timeout: Timeout,
        clock: Callable[[], float] = time.monotonic,
        look: Callable[[], Mapping[int, Glance]] = process_table.table,
    ) -> None:
        self._timeout = timeout
        self._clock = clock
        self._table = look
        self._looked = clock()
        self._cpu_s: dict[int, float] = {}
        self._idle_s: dict[int, float] = {}
        self._worked_s: dict[int, float] = {}
        self.stopped: frozenset[str] = frozenset()
        """Who was held by a signal at the last look."""

    def broken(self) -> None:
        """A step was taken."""
        self._looked = self._clock()
        for account in (self._cpu_s, self._idle_s, self._worked_s):
            account.clear()
        self.stopped = frozenset()

    def verdict(
        self, everyone: Sequence[Suspect], awaited: Sequence[Suspect], what: str, *, starting: bool = False
    ) -> SilenceVerdict | None:
        """Who of `awaited` has used the time up; `what` they are awaited for. None: nobody, as yet.

        `everyone`: all processes of the run; nobody is judged while one of them is stopped.
        """
        now = self._clock()
        if now - self._looked < self._timeout.look_s:
            return None
        elapsed_s = min(now - self._looked, 2 * self._timeout.look_s)
        self._looked = now
        known = self._table()
        trees = {
            one.pid: [known[pid] for pid in process_table.descendants((one.pid,), known)] for one in everyone
        }
        self.stopped = frozenset(one.name for one in everyone if any(p.stopped for p in trees[one.pid]))
        for suspect in awaited:
            self._charge(suspect, trees.get(suspect.pid, []), elapsed_s)
        if self.stopped:
            return None
        return next((found for one in awaited if (found := self._judge(one, what, starting))), None)

    def _charge(self, suspect: Suspect, tree: Sequence[Glance], elapsed_s: float) -> None:
        cpu_s = sum(one.cpu_s for one in tree)
        before_s = self._cpu_s.get(suspect.pid)
        self._cpu_s[suspect.pid] = cpu_s
        if before_s is None or self.stopped:
            return
        if cpu_s - before_s >= self._timeout.working_share * elapsed_s:
            self._add(self._worked_s, suspect.pid, cpu_s - before_s)
        elif not any(one.state in ("R", "D") for one in tree):  # else it waits for a processor, or a disk
            self._add(self._idle_s, suspect.pid, elapsed_s)

    @staticmethod
    def _add(account: dict[int, float], pid: int, seconds: float) -> None:
        account[pid] = account.get(pid, 0.0) + seconds

    def _judge(self, suspect: Suspect, what: str, starting: bool) -> SilenceVerdict | None:
        limit_s = self._timeout.step_s
        if self._idle_s.get(suspect.pid, 0.0) >= limit_s:
            return SilenceVerdict(suspect, f"{what} for {limit_s:g} s")
        if starting:
            limit_s *= self._timeout.start_factor
        if self._worked_s.get(suspect.pid, 0.0) >= limit_s:
            return SilenceVerdict(suspect, f"{what} after {limit_s:g} s of processor time")
        return None
