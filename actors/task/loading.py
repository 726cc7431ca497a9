"""Loading of tasks: by name, by entry string, or from a folder named on the command line.

A task is trusted code: modules are loaded from installed packages and from folders given by `--modules`,
never from a folder that a file or a recording names.
"""

import importlib.metadata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any, Final, get_origin

import msgspec

from actors.items import ITEM_LIMIT, TaskReports, instant_fault
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note
from actors.settings import ParameterError, words
from actors.task.task import SYMBOLS, Task, TaskDeclaration, TaskError, style_fault
from actors.user_code import FINDER, entry_object, is_installed, module_file
from actors.wording import short_repr, toml_text

GROUP: Final = "acrc.tasks"
"""Entry point group in which an installed distribution registers tasks: name = "module:Class"."""
TASKS: Final = {
    "cleaning": "cleaning.task:CleaningTask",
    "logistics": "logistics.task:Logistics",
}
"""Entry strings of the shipped tasks by name."""
DEFAULT: Final = "cleaning"


class TaskSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The task of a run; recordings hold it in the world's set-up."""

    use: str
    """Entry string `module:Class`."""
    declaration: TaskDeclaration
    settings: dict[str, Any] = {}
    """The task's table in the scenario."""


def task_entry(name: str) -> str:
    """Return the entry string of a task given by name or entry string. Raises TaskError."""
    if ":" in name:
        return name
    if name in TASKS:
        return TASKS[name]
    known = dict(TASKS)
    for point in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda one: (one.name, one.value)):
        known.setdefault(point.name, point.value)
    if name not in known:
        raise TaskError(
            f"unknown task {name!r}; choose from {', '.join(sorted(known))}, "
            f"or give module:Class of your own, such as {name.removesuffix('.py')}:Task"
        )
    return known[name]


@contextmanager
def named_faults(task: Task, method: str) -> Iterator[None]:
    """Convert an exception of the task's code in `method` to a TaskError with its line."""
    try:
        yield
    except AcrcError:
        raise
    except (Exception, SystemExit) as error:
        cause = failure_note("", 0, error).cause
        raise TaskError(f"task {task.declaration.name}, {method} failed: {cause}") from error


@cache
def load_task(name: str) -> Task:
    """Return a task given by name or entry string. Raises TaskError."""
    entry = task_entry(name)
    module = entry.partition(":")[0]
    if not is_installed(module) and not any(module_file(module, one) for one in FINDER.task_folders):
        raise TaskError(f"task {entry!r}: its module is not installed; name its folder with --modules DIR")
    kind = entry_object(entry, "task", TaskError, "module:Task")
    if not (isinstance(kind, type) and issubclass(kind, Task)):
        raise TaskError(f"task {entry!r} is {short_repr(kind)}; must be a subclass of actors.task.Task")
    try:
        task = kind()
    except (Exception, SystemExit) as error:
        cause = failure_note("", 0, error).cause
        raise TaskError(f"task {entry!r} cannot be created: {cause}") from error
    if fault := _declaration_fault(task):
        raise TaskError(f"task {entry!r} {fault}")
    return task


def _declaration_fault(task: Task) -> str | None:
    declaration = getattr(task, "declaration", None)
    if not isinstance(declaration, TaskDeclaration):
        return f"declares {short_repr(declaration)}; must have a TaskDeclaration as attribute `declaration`"
    if not any(metric.rank is not None for metric in declaration.metrics):
        return "declares no metric with a rank; must have at least one, by which runs are compared"
    names = [metric.name for metric in declaration.metrics]
    if len({*names}) < len(names):
        return f"declares the metrics {', '.join(names)}; their names must be unique"
    try:
        for kind in filter(None, (task.item, task.report)):
            msgspec.json.schema(kind)
    except TypeError as error:
        return f"declares an item or report that cannot be sent: {error}"
    return _style_fault(declaration)


def _style_fault(declaration: TaskDeclaration) -> str | None:
    for name, style in (*declaration.marks.items(), *declaration.events.items()):
        if style.symbol not in SYMBOLS:
            return f"declares {name!r} with the symbol {style.symbol!r}; must be one of {', '.join(SYMBOLS)}"
    for name, look in declaration.causes.items():
        if fault := style_fault(look):
            return f"declares the cause {name!r} as {short_repr(look)}; must {fault}"
    return None


def task_setup(name: str, settings: Mapping[str, Any]) -> TaskSetup:
    """Return the set-up of a task with its table; raises TaskError."""
    task = load_task(name)
    schemas = {"item": msgspec.json.schema(task.item)}
    if task.report is not None:
        schemas["report"] = msgspec.json.schema(task.report)
    declaration = msgspec.structs.replace(task.declaration, schemas=schemas)
    return TaskSetup(task_entry(name), declaration, dict(settings))


def decode_items(task: Task, items: Sequence[Any], key: str = "items") -> tuple[Any, ...]:
    """Return plain values as items of the task. Raises ParameterError with the key of a wrong value."""
    return tuple(_decode_item(task, item, f"{key}[{index}]") for index, item in enumerate(items))


def _decode_item(task: Task, item: Any, key: str) -> Any:
    try:
        found = msgspec.convert(item, task.item)
        if len(msgspec.msgpack.encode(found)) > ITEM_LIMIT:
            raise ParameterError(key, item, "", f"{key} is larger than {ITEM_LIMIT} bytes")
    except (msgspec.ValidationError, OverflowError) as error:
        expected = words(task.item, key) if get_origin(task.item) is Annotated else ""
        sentence = "" if expected else f"{key} is {toml_text(item)}: {error}"
        raise ParameterError(key, item, expected, sentence) from None
    return found


class ReportError(AcrcError):
    """A robot's report that is not of the task's type; the text continues the robot's name."""


class _Answer:
    """A robot's reports of one step, with the task's reports decoded."""

    def __init__(self, answer: TaskReports, reports: tuple[Any, ...]) -> None:
        self.reports = reports
        self.given_up = answer.given_up
        self.route = answer.route


def decode_reports(task: Task, answer: TaskReports, begin: int = 0, end: int = 2**63) -> TaskReports:
    """Return the answer with the task's reports decoded.

    Raises ReportError for one of another type, or whose `instant`, µs, is not from `begin` to below `end`.
    """
    if not answer.reports:
        return answer
    if task.report is None:
        raise ReportError(f"reports {short_repr(answer.reports[0])}; the task has no reports")
    try:
        plain = msgspec.to_builtins(answer.reports)
        reports: tuple[Any, ...] = msgspec.convert(plain, tuple[task.report, ...])  # type: ignore[name-defined]
    except msgspec.ValidationError as error:
        raise ReportError(f"reports {short_repr(answer.reports)}: {error}") from None
    for report in reports:
        if fault := instant_fault("sends a task report", getattr(report, "instant", begin), begin, end):
            raise ReportError(fault)
    return _Answer(answer, reports)
