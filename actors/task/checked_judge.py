"""A task's judge with checked answers: a fault of its code is one sentence with method, instant and line."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final, TypeVar

import msgspec

from actors.array_types import Floats
from actors.instant import Instant, in_seconds
from actors.items import TaskReports
from actors.messages import ItemMark, TaskEvent
from actors.runtime.failure import failure_note
from actors.task.task import Judge, JudgeSetup, Task, TaskError, TaskOutcome, TaskProgress
from actors.wording import short_repr

T = TypeVar("T")
_VALUES: Final = (bool, int, float, str, type(None))


class CheckedJudge(Judge):
    """Judge that checks the answers of the task's judge; raises TaskError for a fault of the task's code."""

    def __init__(self, task: Task, setup: JudgeSetup) -> None:
        self._declaration, self._robots = task.declaration, setup.robots
        self._now = 0
        self._is_busy = False
        self._progress = TaskProgress(0, 0)
        self.judge: Judge = self._call("judge", lambda: task.judge(setup))
        """The task's judge."""
        if not isinstance(self.judge, Judge):
            raise self._error("judge", f"returned {short_repr(self.judge)}; must be a Judge")

    @property
    def settled(self) -> bool:
        """True once the task is finished."""
        settled = self._call("settled", lambda: self.judge.settled)
        if not isinstance(settled, bool):
            raise self._error("settled", f"is {short_repr(settled)}; must be True or False")
        return settled

    def watch(self, instant: Instant, positions: Floats) -> None:
        """Process the true positions."""
        self._now = int(instant)
        self._call("watch", lambda: self.judge.watch(instant, positions))

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Process a robot's reports."""
        return self._sentence("take", lambda: self.judge.take(robot, answer, begin, end))

    def restart(self, robot: str) -> None:
        """Process the restart of a robot."""
        self._call("restart", lambda: self.judge.restart(robot))

    def give(self, instant: Instant, robot: str, items: Sequence[Any]) -> str | None:
        """Process an order that gives further items to a robot."""
        return self._sentence("give", lambda: self.judge.give(instant, robot, items))

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Return the progress; if called by a signal handler during another method, the last one."""
        if not self._is_busy:
            progress = self._call("progress", lambda: self.judge.progress(present))
            if not isinstance(progress, TaskProgress) or any(type(one) is not int for one in progress):
                fault = f"returned {short_repr(progress)}; must be a TaskProgress of whole numbers"
                raise self._error("progress", fault)
            self._progress = progress
        return self._progress

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        """Return the outcome."""
        outcome = self._call("outcome", lambda: self.judge.outcome(present, end))
        if fault := self._outcome_fault(outcome):
            raise self._error("outcome", fault)
        return outcome

    def take_changes(self) -> tuple[tuple[ItemMark, ...], tuple[TaskEvent, ...]]:
        """Remove and return the marks and events since the last call."""
        marks, events = self.judge.take_changes()
        states, kinds = self._declaration.marks, {*self._declaration.events, *self._declaration.causes}
        self._check("mark", marks, lambda one: one.state in {*states, ""}, f"in a state of {[*states]}")
        self._check("note", events, lambda one: one.kind in {*kinds, ""}, f"of a kind of {sorted(kinds)}")
        self._check("note", events, lambda one: one.robot in self._robots, "of a robot of the run")
        return marks, events

    def _check(self, method: str, parts: Sequence[T], is_known: Callable[[T], bool], expected: str) -> None:
        for part in parts:
            try:
                msgspec.convert(msgspec.to_builtins(part), type(part))
            except (TypeError, msgspec.ValidationError) as error:
                raise self._error(method, f"got {short_repr(part)}: {error}") from None
            if not is_known(part):
                raise self._error(method, f"got {short_repr(part)}; must be {expected}")

    def _outcome_fault(self, outcome: object) -> str | None:
        if not isinstance(outcome, TaskOutcome):
            return f"returned {short_repr(outcome)}; must be a TaskOutcome"
        for metric in self._declaration.metrics:
            value = outcome.values.get(metric.column, "")
            if type(value) not in {int, float, type(None)}:
                is_missing = metric.column not in outcome.values
                found = "no value" if is_missing else f"the value {short_repr(value)}"
                return f"has {found} in column {metric.column!r} of a metric; must be a number or None"
        if {*outcome.robots} != {*self._robots}:
            return f"has values of {', '.join(outcome.robots) or 'no robot'}; must have those of each robot"
        columns = {column.name for column in self._declaration.columns}
        for row in outcome.items:
            if unknown := row.keys() - columns:
                return f"has an item with {min(unknown)!r}; must be a declared column"
        rows = (outcome.values, *outcome.robots.values(), *outcome.items)
        return _value_fault(rows) or _text_fault((outcome.summary, *outcome.notes))

    def _sentence(self, method: str, call: Callable[[], str | None]) -> str | None:
        answer = self._call(method, call)
        if answer is not None and not isinstance(answer, str):
            raise self._error(method, f"returned {short_repr(answer)}; must be None or a sentence")
        return answer

    def _call(self, method: str, call: Callable[[], T]) -> T:
        self._is_busy = True
        try:
            return call()
        except (Exception, SystemExit) as error:
            raise self._error(method, f"failed: {failure_note('', 0, error).cause}") from error
        finally:
            self._is_busy = False

    def _error(self, method: str, fault: str) -> TaskError:
        return TaskError(f"task {self._declaration.name}, {method} at {in_seconds(self._now):g} s {fault}")


def _value_fault(rows: Iterable[Mapping[str, object]]) -> str | None:
    for row in rows:
        for name, value in row.items():
            if type(value) not in _VALUES or (isinstance(value, float) and not math.isfinite(value)):
                return f"has {name!r} = {short_repr(value)}; must be a finite number, text, boolean or None"
    return None


def _text_fault(texts: Iterable[object]) -> str | None:
    wrong = next((text for text in texts if not isinstance(text, str)), None)
    return None if wrong is None else f"has {short_repr(wrong)} as summary or note; must be a text"
