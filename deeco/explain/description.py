"""Descriptions of components and ensembles: schedules, fields read and written, a Mermaid flowchart.

The chart shows the adapted and the adaptation layer after Fig. 7.3 of *Experimenting with Adaptation in Smart
Cyber-Physical Systems: A Model Problem and Testbed*: below, the ports and the business processes; above, the
adaptation, drawn as a process if it uses one component only, otherwise as an ensemble. Arrows are fields that
one part writes and another reads.
"""

import dataclasses
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import permutations, zip_longest
from typing import Any, Final

from deeco.ensemble import Contact, EndReason, ensemble_type
from deeco.explain.knowledge_use import ComponentPart, method_flow, methods, rhythm_of
from deeco.history import histories, published_fields
from deeco.instant import Duration, Instant, in_seconds
from deeco.knowledge import Knowledge, describe, field_type, local_fields, role_fields, roles_of
from deeco.modes import MODE, chart_of

WIDTH: Final = 110
_LABEL: Final = 12
_NO_BREAK: Final = "\u00a0"
"""Keeps a field and its type on one line."""


def component_text(cls: type[Knowledge], processes: Sequence[ComponentPart]) -> list[str]:
    """Describe a component: its roles, local fields and processes."""
    lines = [f"{cls.__name__}, a component"]
    for role in roles_of(cls):
        lines += _entry("publishes", f"as {role.__name__}: {_typed(role, published_fields(role))}")
    past = histories(cls)
    lines += _entry("keeps local", _typed(cls, [one for one in local_fields(cls) if one not in past]))
    for name, history in past.items():
        age = "" if history.max_age is None else f", at most {in_seconds(history.max_age):g} s old"
        lines += _entry("collects", f"{name}: the last {history.size} values of {history.of}{age}")
    if transitions := chart_of(cls).transitions:
        lines += _entry("starts in", getattr(cls, MODE).name)
        for one in transitions:
            lines += _entry("transition", f"{one.source.name} → {one.target.name} {one.condition}")
    for process in processes:
        layer = "adaptation" if process.adaptation else "adapted"
        lines += ["", *_heading(f"  {process.name}, a process of the {layer} layer, {process.when}")]
        lines += _entry("reads", names(process.reads))
        lines += _entry("writes", names(process.writes))
        lines += _ports_and_unknowns(process.ports, process.unknowns)
    return lines if processes else [*lines, "", "  It has no processes."]


def ensemble_text(cls: type, subject: object) -> list[str]:
    """Describe an ensemble (class or instance): parameters, fields read and written."""
    kind = ensemble_type(cls)
    assert kind is not None
    lines = _heading(f"{kind.name}, an ensemble, {rhythm_of(kind)}")
    if kind.members:
        lines += _entry(
            "members",
            names(
                f"{name}: {one.least} to {one.most} {one.role.__name__}" for name, one in kind.members.items()
            ),
        )
    if parameters := [_parameter(field, subject) for field in dataclasses.fields(cls)]:
        lines += _entry("parameters", names(parameters))
    for method in methods(kind):
        lines += ["", f"  {method.name}"]
        found = method_flow(cls, method)
        for side, role in method.sides:
            written = found.written(side)
            text = f"{role.__name__}; reads {names(found.read(side))}"
            lines += _entry(side, text + (f"; writes {names(written)}" if written else ""))
        lines += _ports_and_unknowns(method.ports, found.unknowns)
    return lines


def _parameter(field: "dataclasses.Field[Any]", subject: object) -> str:
    text = f"{field.name}: {field.type if isinstance(field.type, str) else _type_text(field.type)}"
    value = getattr(subject, field.name, dataclasses.MISSING)  # a class has its defaults as attributes
    if value is dataclasses.MISSING:
        return text
    return text + (f" = {in_seconds(value):g} s" if field.type is Duration else f" = {value!r}")


def field_table(cls: type[Knowledge], parts: Sequence[ComponentPart]) -> list[str]:
    """List every field of a component with the parts that write and read it."""
    shared = dict.fromkeys(name for role in roles_of(cls) for name in role_fields(role))
    rows = [(f"{cls.__name__}'s field", "written by", "read by", "read on peers' nodes by")]
    for name in (*shared, *local_fields(cls)):
        writers = names(part.name for part in parts if name in part.writes)
        readers = names(part.name for part in parts if name in part.reads)
        rows.append(
            (name, writers, readers, names(part.name for part in parts if name in part.read_by_peers))
        )
    first = max(len(row[0]) for row in rows) + 2
    width = (WIDTH - first) // 3
    lines = []
    for row in rows:
        cells = [[row[0]], *(textwrap.wrap(cell, width - 2) for cell in row[1:])]
        for texts in zip_longest(*cells, fillvalue=""):
            lines.append((f"{texts[0]:{first}}" + "".join(f"{text:{width}}" for text in texts[1:])).rstrip())
    lines.insert(1, "─" * (first + 3 * width))
    if incomplete := [part.name for part in parts if part.unknowns]:
        text = f"The table may lack fields used by {names(incomplete)}: see 'unknown' above."
        lines += textwrap.wrap(text, WIDTH)
    return lines


def mermaid_chart(components: Mapping[type[Knowledge], Sequence[ComponentPart]]) -> list[str]:
    """Draw both layers and the modes of components as a Mermaid flowchart."""
    lines = ["flowchart TB"]
    for cls, parts in components.items():
        name = cls.__name__
        lines += [f'    subgraph {name}["{name}"]', *(f"        {line}" for line in _chart(name, parts))]
        lines += [*(f"        {line}" for line in _mode_chart(cls)), "    end"]
    return lines


def _mode_chart(cls: type[Knowledge]) -> Iterator[str]:
    if transitions := chart_of(cls).transitions:
        prefix, initial = f"{cls.__name__}_mode", getattr(cls, MODE)
        yield f'subgraph {prefix}s["modes"]'
        yield from (f'    {prefix}_{mode.name}(["{mode.name}"])' for mode in type(initial))
        yield f"    {prefix}s_start((start)) --> {prefix}_{initial.name}"
        for one in transitions:
            yield f'    {prefix}_{one.source.name} -- "{one.condition}" --> {prefix}_{one.target.name}'
        yield "end"


def _chart(owner: str, parts: Sequence[ComponentPart]) -> Iterator[str]:
    yield f'subgraph {owner}_adaptation["adaptation layer"]'
    yield from (f"    {_node(owner, part)}" for part in parts if part.adaptation)
    yield "end"
    yield f'subgraph {owner}_adapted["adapted layer"]'
    yield from (f"    {_node(owner, part)}" for part in parts if not part.adaptation)
    for name in dict.fromkeys(name for part in parts for name in _port_types(part)):
        yield f'    {_id(owner, "port", name)}[/"{_escaped(name)}"/]'
    yield "end"
    if any(part.peer_reads for part in parts):
        yield f'{owner}_peers(["peers"])'
    for giver, taker in permutations(parts, 2):
        fields = [name for name in giver.writes if name in taker.reads]
        if fields and (giver.adaptation or taker.adaptation):
            yield f'{_part_id(owner, giver)} -- "{", ".join(fields)}" --> {_part_id(owner, taker)}'
    for part in parts:
        if part.peer_reads:
            yield f'{owner}_peers -- "{", ".join(part.peer_reads)}" --> {_part_id(owner, part)}'
        for name in _port_types(part):
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


def _port_types(part: ComponentPart) -> dict[str, None]:
    """Return the types of its ports except those that every node has."""
    return dict.fromkeys(
        _type_text(kind) for _, kind in part.ports if kind not in {Instant, Contact, EndReason}
    )


def _heading(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, subsequent_indent="    ", break_on_hyphens=False)


def _entry(label: str, text: str) -> list[str]:
    """Return a label with a wrapped text beside it."""
    indent = " " * (_LABEL + 5)
    lines = textwrap.wrap(
        text, WIDTH, initial_indent=f"    {label:{_LABEL}} ", subsequent_indent=indent, break_on_hyphens=False
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def names(items: Iterable[str]) -> str:
    """Join with commas; return a dash for no items."""
    return ", ".join(items) or "—"


def _type_text(annotation: Any) -> str:
    """Return a type as in the source, without module names."""
    return re.sub(r"\b(?:\w+\.)+(?=\w)", "", describe(annotation))


def _ports_and_unknowns(ports: Sequence[tuple[str, Any]], unknowns: Iterable[str]) -> list[str]:
    lines = [line for unknown in unknowns for line in _entry("unknown", unknown)]
    if ports:
        lines[:0] = _entry("ports", names(f"{name}: {_type_text(kind)}" for name, kind in ports))
    return lines


def _typed(cls: type[Knowledge], fields: Sequence[str]) -> str:
    texts = (f"{name}: {_type_text(field_type(cls, name))}" for name in fields)
    return names(text.replace(" ", _NO_BREAK) for text in texts)
