"""How much a host has to do, from what it tells once a second."""

import math
import time
from collections.abc import Sequence

from deploy.hosts.host_messages import Glimpse
from observation.results.hosts_file import HostLoad


class LoadMeter:
    """Adds up what its processes did between two answers, and how long answers took."""

    def __init__(self) -> None:
        self._asked_s = self._seen_s = math.nan
        self._before: dict[int, Glimpse] = {}
        self._watched_s = self._worked_s = self._waited_s = 0.0
        self._answers, self._answer_s, self._slowest_s = 0, 0.0, 0.0

    def asked(self) -> None:
        """It was asked now; while an answer is out, only the first time counts."""
        if math.isnan(self._asked_s):
            self._asked_s = time.monotonic()

    def answered(self, processes: Sequence[Glimpse]) -> None:
        """It has told of its processes now."""
        now = time.monotonic()
        if not math.isnan(self._asked_s):
            self._answers += 1
            self._answer_s += now - self._asked_s
            self._slowest_s = max(self._slowest_s, now - self._asked_s)
            self._asked_s = math.nan
        both = [(self._before[one.pid], one) for one in processes if one.pid in self._before]
        if both:
            self._watched_s += now - self._seen_s
            self._worked_s += math.fsum(max(one.cpu_s - before.cpu_s, 0.0) for before, one in both)
            self._waited_s += math.fsum(_waited_s(before, one) for before, one in both)
        self._before, self._seen_s = {one.pid: one for one in processes}, now

    @property
    def load(self) -> HostLoad:
        """So far."""
        watched_s, answers = self._watched_s or math.inf, self._answers or 1
        return HostLoad(
            worked=round(self._worked_s / watched_s, 3),
            waited=round(self._waited_s / watched_s, 3),
            answer_s=round(self._answer_s / answers, 4),
            slowest_s=round(self._slowest_s, 4),
        )


def _waited_s(before: Glimpse, now: Glimpse) -> float:
    if before.queued_s is None or now.queued_s is None:
        return 0.0
    return max(now.queued_s - before.queued_s, 0.0)
