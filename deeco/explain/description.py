"""Components and ensembles in words: when what runs, and who reads and writes which knowledge."""

import dataclasses
import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, Final

from deeco.explain.anatomy import ComponentPart, Method, ensemble_type, method_flow, methods, rhythm_of
from deeco.immutability import describe
from deeco.instant import Duration, in_seconds
from deeco.knowledge import Knowledge, local_fields, published, roles_of, type_of

WIDTH: Final = 110
_LABEL: Final = 12
_NO_BREAK: Final = "\u00a0"
"""Keeps a field and its type on one line."""


def component_text(cls: type[Knowledge], processes: Sequence[ComponentPart]) -> list[str]:
    """A component: its roles, its own fields, its processes."""
    lines = [f"{cls.__name__}, a component"]
    for role in roles_of(cls):
        lines += entry("publishes", f"as {role.__name__}: {_typed(role, published(role))}")
    lines += entry("keeps local", _typed(cls, local_fields(cls)))
    for process in processes:
        layer = "adaptation" if process.adaptation else "adapted"
        lines += ["", *heading(f"  {process.name}, a process of the {layer} layer, {process.when}")]
        lines += entry("reads", names(process.reads))
        lines += entry("writes", names(process.writes))
        lines += _ports(process.ports) + _doubts(process.doubts)
    return lines if processes else [*lines, "", "  It has no processes."]


def ensemble_text(cls: type, instance: object | None) -> list[str]:
    """An ensemble: its parameters, and what it reads and writes on which side."""
    kind = ensemble_type(cls)
    assert kind is not None
    lines = heading(f"{kind.name}, an ensemble, {rhythm_of(kind)}")
    if dataclasses.fields(cls):
        lines += entry("parameters", names(_parameters(cls, instance)))
    for method in methods(kind):
        lines += ["", f"  {method.name}"]
        lines += _method(cls, method)
    return lines


def _method(cls: type, method: Method) -> list[str]:
    found = method_flow(cls, method)
    lines = []
    for side, kind in method.sides:
        text = f"{kind.__name__}; reads {names(found.read(side))}"
        if found.written(side):
            text += f"; writes {names(found.written(side))}"
        lines += entry(side, text)
    return lines + _ports(method.ports) + _doubts(found.doubts)


def _parameters(cls: type, instance: object | None) -> list[str]:
    texts = []
    for field in dataclasses.fields(cls):
        text = f"{field.name}: {field.type if isinstance(field.type, str) else type_text(field.type)}"
        value = field.default if instance is None else getattr(instance, field.name)
        if field.type is Duration and isinstance(value, int):
            text += f" = {in_seconds(value):g} s"
        elif value is not dataclasses.MISSING:
            text += f" = {value!r}"
        texts.append(text)
    return texts


def table(cls: type[Knowledge], parts: Sequence[ComponentPart]) -> list[str]:
    """Every field of a component with those who write and read it; and what that leaves open."""
    shared = tuple(dict.fromkeys(name for role in roles_of(cls) for name in published(role)))
    rows = [(f"{cls.__name__}'s field", "written by", "read by", "read on peers' nodes by")]
    rows += [(name, *_users(name, parts)) for name in shared + local_fields(cls)]
    first = max(len(row[0]) for row in rows) + 2
    width = (WIDTH - first) // 3
    lines = []
    for number, row in enumerate(rows):
        lines += _row(row, first, width)
        if number == 0:
            lines.append("─" * (first + 3 * width))
    if doubtful := [part.name for part in parts if part.doubts]:
        text = f"More may be read or written than the table says, by {names(doubtful)}: see above."
        lines += textwrap.wrap(text, WIDTH)
    return lines


def _users(field: str, parts: Sequence[ComponentPart]) -> tuple[str, str, str]:
    return (
        names(part.name for part in parts if field in part.writes),
        names(part.name for part in parts if field in part.reads),
        names(part.name for part in parts if field in part.tells),
    )


def _row(cells: Sequence[str], first: int, width: int) -> list[str]:
    columns = [[cells[0]], *(textwrap.wrap(cell, width - 2) for cell in cells[1:])]
    height = max(len(column) for column in columns)
    lines = []
    for index in range(height):
        texts = [column[index] if index < len(column) else "" for column in columns]
        lines.append((f"{texts[0]:{first}}" + "".join(f"{text:{width}}" for text in texts[1:])).rstrip())
    return lines


def heading(text: str) -> list[str]:
    """A line, or as many as it needs."""
    return textwrap.wrap(text, WIDTH, subsequent_indent="    ", break_on_hyphens=False)


def entry(label: str, text: str) -> list[str]:
    """A label, and a text beside it that takes as many lines as it needs."""
    indent = " " * (_LABEL + 5)
    lines = textwrap.wrap(
        text, WIDTH, initial_indent=f"    {label:{_LABEL}} ", subsequent_indent=indent, break_on_hyphens=False
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def names(items: Iterable[str]) -> str:
    """Items with commas between them, a dash for none."""
    return ", ".join(items) or "—"


def type_text(annotation: Any) -> str:
    """A type as in the source, without the modules that its names stand in."""
    return re.sub(r"\b(?:\w+\.)+(?=\w)", "", describe(annotation))


def _ports(ports: Sequence[tuple[str, Any]]) -> list[str]:
    return entry("ports", names(f"{name}: {type_text(kind)}" for name, kind in ports)) if ports else []


def _typed(cls: type[Knowledge], fields: Sequence[str]) -> str:
    texts = (f"{name}: {type_text(type_of(cls, name))}" for name in fields)
    return names(text.replace(" ", _NO_BREAK) for text in texts)


def _doubts(doubts: Iterable[str]) -> list[str]:
    return [line for doubt in doubts for line in entry("cannot tell", doubt)]
