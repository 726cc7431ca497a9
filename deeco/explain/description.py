"""Components and ensembles in words: when what runs, and who reads and writes which knowledge.

The drawings show the adapted and the adaptation layer of a component, as text or Mermaid flowchart.
After Fig. 7.3 of *Experimenting with Adaptation in Smart Cyber-Physical Systems: A Model Problem and
Testbed*: below, the ports and the business logic in processes; above, the adaptation, a process if it looks
at one component only, an ensemble if it takes several. Arrows are the knowledge that one writes and another
reads.
"""

import dataclasses
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any, Final, NamedTuple

from deeco.ensemble import Contact
from deeco.explain.anatomy import ComponentPart, Method, ensemble_type, method_flow, methods, rhythm_of
from deeco.instant import Duration, Instant, in_seconds
from deeco.knowledge import Knowledge, describe, local_fields, published, roles_of, type_of

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


_WRAP: Final = 46
_GAP: Final = 2


class _Column(NamedTuple):
    """A box, with two lists below it that lines go to."""

    head: list[str]
    marks: tuple[str, str]
    """Where the lines meet the box: ▲ comes in, anything else goes out."""
    below: tuple[Sequence[str], Sequence[str]]

    @property
    def left(self) -> int:
        """Width of the left list."""
        return max((len(text) for text in self.below[0]), default=-2) + 2

    @property
    def width(self) -> int:
        right = max((len(text) for text in self.below[1]), default=0)
        return max(*(len(line) + 4 for line in self.head), len(self.head[0]) + 6, 5 + self.left + right)


def shared(giver: ComponentPart, taker: ComponentPart) -> tuple[str, ...]:
    """Fields that one writes and the other reads."""
    return tuple(name for name in giver.writes if name in taker.reads)


def text_drawing(parts: Sequence[ComponentPart]) -> list[str]:
    """Both layers, at most 110 columns wide."""
    adapted, adaptation = _layers(parts)
    lines = [_ruler("adaptation layer")]
    lines += _rows([_upper(part, adapted) for part in adaptation], tails=("│", "▼"))
    lines += [_ruler("adapted layer")]
    return lines + _rows([_lower(part, adaptation) for part in adapted], tails=("", ""))


def _layers(parts: Sequence[ComponentPart]) -> tuple[list[ComponentPart], list[ComponentPart]]:
    return [one for one in parts if not one.adaptation], [one for one in parts if one.adaptation]


def _ruler(title: str) -> str:
    return f"── {title} ".ljust(WIDTH, "─")


def _upper(part: ComponentPart, adapted: Sequence[ComponentPart]) -> _Column:
    head = [part.name, *_wrapped(("ensemble, " if part.is_ensemble else "process, ") + part.when)]
    head += _wrapped("hears of peers: " + ", ".join(part.hears)) if part.hears else []
    head += _wrapped("ports: " + ", ".join(devices(part))) if devices(part) else []
    up = dict.fromkeys(name for one in adapted for name in shared(one, part))
    down = dict.fromkeys(name for one in adapted for name in shared(part, one))
    return _Column(head, ("▲", "┬"), (tuple(up), tuple(down)))


def _lower(part: ComponentPart, adaptation: Sequence[ComponentPart]) -> _Column:
    head = [part.name, *_wrapped(part.when)]
    up = dict.fromkeys(name for one in adaptation for name in shared(part, one))
    down = dict.fromkeys(name for one in adaptation for name in shared(one, part))
    head += _wrapped("▲ " + ", ".join(up)) if up else []
    head += _wrapped("▼ " + ", ".join(down)) if down else []
    return _Column(head, ("┬", "┬"), (tuple(f"[{name}]" for name in devices(part)), ()))


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WRAP, subsequent_indent="  ", break_on_hyphens=False)


def devices(part: ComponentPart) -> tuple[str, ...]:
    """Types of its ports, without what every node has."""
    kinds = dict.fromkeys(kind for _, kind in part.ports if kind not in {Instant, Contact})
    return tuple(type_text(kind) for kind in kinds)


def _rows(columns: Sequence[_Column], tails: tuple[str, str]) -> list[str]:
    if not columns:
        return ["  nothing"]
    lines: list[str] = []
    for row in _packed(columns):
        boxes = max(len(column.head) for column in row)
        lists = max(len(names) for column in row for names in column.below)
        drawn = [_drawn(column, boxes, lists, tails) for column in row]
        for pieces in zip(*drawn, strict=True):
            lines.append((" " * _GAP + (" " * _GAP).join(pieces)).rstrip())
        while not lines[-1]:
            lines.pop()
    return lines


def _packed(columns: Sequence[_Column]) -> Iterator[list[_Column]]:
    row: list[_Column] = []
    for column in columns:
        if row and sum(one.width + _GAP for one in (*row, column)) > WIDTH:
            yield row
            row = []
        row.append(column)
    yield row


def _drawn(column: _Column, boxes: int, lists: int, tails: tuple[str, str]) -> list[str]:
    """One column of a row whose boxes and lists have so many lines."""
    width = column.width
    lines = [f"┌─ {column.head[0]} ".ljust(width - 1, "─") + "┐"]
    padded = [*column.head[1:], *[""] * (boxes - len(column.head))]
    lines += [f"│ {text:{width - 4}} │" for text in padded]
    lines.append("└" + _at(column, *column.marks, fill="─")[1:].ljust(width - 2, "─") + "┘")
    lines.append(_at(column, "│", "│").ljust(width))
    for index in range(lists):
        texts = [names[index] if index < len(names) else "" for names in column.below]
        lines.append(_at(column, texts[0], texts[1]).ljust(width))
    if any(tails):
        lines.append(_at(column, *tails).ljust(width))
    return lines


def _at(column: _Column, left: str, right: str, fill: str = " ") -> str:
    """Two texts where the lines of the column are; nothing for a list that is empty."""
    left, right = (text if names else "" for text, names in zip((left, right), column.below, strict=True))
    return (fill * 3 + left).ljust(3 + column.left, fill) + right


def mermaid_drawing(components: Sequence[tuple[str, Sequence[ComponentPart]]]) -> list[str]:
    """Both layers of components, given by their names, as a flowchart for Mermaid."""
    lines = ["flowchart TB"]
    for name, parts in components:
        lines += [f'    subgraph {name}["{name}"]']
        lines += [f"        {line}" for line in _chart(name, parts)]
        lines += ["    end"]
    return lines


def _chart(owner: str, parts: Sequence[ComponentPart]) -> Iterator[str]:
    adapted, adaptation = _layers(parts)
    yield f'subgraph {owner}_adaptation["adaptation layer"]'
    yield from (f"    {_node(owner, part)}" for part in adaptation)
    yield "end"
    yield f'subgraph {owner}_adapted["adapted layer"]'
    yield from (f"    {_node(owner, part)}" for part in adapted)
    for name in dict.fromkeys(name for part in parts for name in devices(part)):
        yield f'    {_id(owner, "port", name)}[/"{_escaped(name)}"/]'
    yield "end"
    if any(part.hears for part in parts):
        yield f'{owner}_peers(["peers"])'
    yield from _arrows(owner, parts)


def _arrows(owner: str, parts: Sequence[ComponentPart]) -> Iterator[str]:
    for giver, taker in product(parts, parts):
        names = shared(giver, taker)
        if names and giver is not taker and (giver.adaptation or taker.adaptation):
            yield f'{_part_id(owner, giver)} -- "{", ".join(names)}" --> {_part_id(owner, taker)}'
    for part in parts:
        if part.hears:
            yield f'{owner}_peers -- "{", ".join(part.hears)}" --> {_part_id(owner, part)}'
        for name in devices(part):
            yield f"{_id(owner, 'port', name)} --- {_part_id(owner, part)}"


def _node(owner: str, part: ComponentPart) -> str:
    text = f'"{part.name}<br/>{_escaped(part.when)}"'
    return _part_id(owner, part) + (f"{{{{{text}}}}}" if part.is_ensemble else f"[{text}]")


def _part_id(owner: str, part: ComponentPart) -> str:
    return _id(owner, "ensemble" if part.is_ensemble else "process", part.name)


def _id(owner: str, kind: str, name: str) -> str:
    return f"{owner}_{kind}_" + re.sub(r"\W", "_", name)


def _escaped(text: str) -> str:
    return text.replace('"', "#quot;")
