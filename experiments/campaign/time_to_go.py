"""How long the rest of a campaign will take, from what its trials took so far."""

from collections.abc import Iterable, Sequence
from statistics import fmean

from experiments.campaign.store import Pending

_Kind = tuple[str, tuple[tuple[str, object], ...], bool]


class TimeToGo:
    """Trials of different strategies and variants take differently long, and repetitions longer still."""

    def __init__(self) -> None:
        self._took: dict[_Kind, list[float]] = {}

    def learn(self, pending: Pending, took_s: float) -> None:
        """Take in what one of them took."""
        self._took.setdefault(_kind(pending), []).append(took_s)

    def left_s(
        self, waiting: Iterable[Pending], running: Sequence[tuple[Pending, float]], slots: int
    ) -> float | None:
        """What is left if so many go on at once; None before anything has ended.

        `running`: what has begun, and for how long it has run. A kind of which none has ended yet takes what
        the others took on average.
        """
        if not self._took:
            return None
        means = {kind: fmean(spans) for kind, spans in self._took.items()}
        overall = fmean(means.values())
        begun = [max(means.get(_kind(pending), overall) - since, 0.0) for pending, since in running]
        to_come = sum(means.get(_kind(pending), overall) for pending in waiting)
        return max((sum(begun) + to_come) / max(slots, 1), max(begun, default=0.0))


def _kind(pending: Pending) -> _Kind:
    trial = pending.trial
    return trial.strategy, tuple((key, repr(value)) for key, value in trial.variant), pending.check
