"""What the adaptation layer of a robot's component has decided, and when it held the robot to be blocked.

For measuring alone: it goes into the robot's last record and takes no part in what the robot does.
"""

from typing import Any, Final, Protocol, Self, runtime_checkable

from actors.geometry import Point
from actors.instant import Instant
from deeco import Knowledge
from deeco.component import processes_of
from deeco.local import Commit

SUBJECT: Final = "adaptation"
"""Under which it stands in the outcome."""
_KEPT: Final = 1000
"""Decisions, and spells of being blocked, that are listed one by one; what comes later is counted only."""


@runtime_checkable
class Deciding(Protocol):
    """A component whose decisions can be told."""

    @property
    def target(self) -> Point | None:
        """Where it wants to be, m, map frame."""

    def decided_since(self, before: Self) -> str:
        """What it has decided since it was `before`, in words; empty if nothing."""


class DecisionLog:
    """Takes down, commit by commit, what one component decides and holds itself to be."""

    def __init__(self, component: Knowledge, former: "DecisionLog | None" = None) -> None:
        """`former`: the log of the robot's component before this one; its lists go on here."""
        kind = type(component)
        adapts = any(process.adaptation for process in processes_of(kind))
        self._decides = isinstance(component, Deciding)
        self._diagnoses = adapts and callable(getattr(kind, "is_blocked", None))
        self._decisions: list[dict[str, Any]] = [] if former is None else former._decisions
        self._blocked: list[list[Instant | None]] = [] if former is None else former._blocked
        self._unlisted: int = 0 if former is None else former._unlisted
        self._is_blocked: bool = former is not None and former._is_blocked

    def take(self, commit: Commit) -> None:
        """A change of the component's knowledge."""
        before: Any = commit.before
        after: Any = commit.after
        if self._diagnoses:
            self._diagnose(after.is_blocked(), commit.instant)
        if not (self._decides and commit.adaptation):
            return
        if words := after.decided_since(before):
            self._decide(commit, words, before.target, after.target)

    def outcome(self) -> dict[str, object]:
        """The lists, for the result; instants in µs. `blocked` is None for who never asks whether it is."""
        return {
            "decisions": self._decisions,
            "decisions_unlisted": self._unlisted,
            "blocked": self._blocked if self._diagnoses or self._blocked else None,
        }

    def _decide(self, commit: Commit, words: str, old: Point | None, new: Point | None) -> None:
        if len(self._decisions) == _KEPT:
            self._unlisted += 1
            return
        heard = commit.instant if commit.heard is None else commit.heard
        self._decisions.append(
            {
                "instant": commit.instant,
                "by": commit.by,
                "words": words,
                "source": commit.peer or commit.after.id,
                "age": commit.instant - heard,
                "old": None if old is None else [old.x, old.y],
                "new": None if new is None else [new.x, new.y],
            }
        )

    def _diagnose(self, is_blocked: bool, now: Instant) -> None:
        """Spells up to _KEPT; the last one kept stays open no longer than it was."""
        if is_blocked is self._is_blocked:
            return
        self._is_blocked = is_blocked
        if not is_blocked:
            if self._blocked and self._blocked[-1][1] is None:
                self._blocked[-1][1] = now
        elif len(self._blocked) < _KEPT:
            self._blocked.append([now, None])
