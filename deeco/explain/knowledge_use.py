"""Use of knowledge by the processes of a component class and by the ensembles that it takes part in."""

import inspect
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from deeco.component import ChangeTrigger, PeriodicTrigger, Process, processes_of
from deeco.ensemble import COORDINATOR, MEMBER, EnsembleType, ensemble_type
from deeco.explain.dataflow import Flow, analyse_flow
from deeco.groups import AT_GROUP, PRIORITY
from deeco.instant import in_seconds
from deeco.knowledge import Fact, Knowledge, has_fact, is_component
from deeco.modes import MODE, chart_of

_MEMBERSHIP: Final = "membership"
_BOUNDARY: Final = "boundary"


@dataclass(frozen=True)
class ComponentPart:
    """A process of a component, or an ensemble that a component takes part in."""

    name: str
    when: str
    is_ensemble: bool
    adaptation: bool
    """True in the adaptation layer, and for every ensemble."""
    ports: tuple[tuple[str, Any], ...] = ()
    reads: tuple[str, ...] = ()
    """Fields of the component that it reads."""
    writes: tuple[str, ...] = ()
    peer_reads: tuple[str, ...] = ()
    """Fields of peers that it reads."""
    read_by_peers: tuple[str, ...] = ()
    """Fields of the component that it reads on peers' nodes."""
    unknowns: tuple[str, ...] = ()
    """Accesses that the analysis cannot resolve."""


class Method(NamedTuple):
    """A method of an ensemble; its first parameters are the sides, two of a pair."""

    name: str
    sides: tuple[tuple[str, type[Knowledge]], ...]
    """Parameter and class of both sides; of a group's members that of each."""
    ports: tuple[tuple[str, Any], ...]
    local: tuple[str, ...]
    """Sides that can be local."""


def processes(cls: type[Knowledge]) -> tuple[ComponentPart, ...]:
    """Return the processes of a component class."""
    return tuple(_process(cls, process) for process in processes_of(cls))


def _process(cls: type[Knowledge], process: Process) -> ComponentPart:
    function = getattr(cls, process.name)
    own = next(iter(inspect.signature(function).parameters))
    found = analyse_flow(function, {own: cls}, returns_knowledge=True)
    schedule = process.schedule
    facts = schedule.facts if isinstance(schedule, ChangeTrigger) else ()
    watched = [_fact_flow(fact, cls) for fact in facts]
    active = "".join(f", in {mode.name}" for mode in schedule.modes)
    return ComponentPart(
        name=process.name,
        when=(_rhythm(schedule) if isinstance(schedule, PeriodicTrigger) else _change(facts)) + active,
        is_ensemble=False,
        adaptation=process.adaptation,
        ports=process.ports,
        reads=_union([found.read(own), *(one.read("self") for one in watched), (MODE,) if active else ()]),
        writes=found.written(own),
        unknowns=_union([found.unknowns, *(one.unknowns for one in watched)]),
    )


def mode_part(cls: type[Knowledge]) -> ComponentPart | None:
    """Return the transitions of a component class as one part; None without modes."""
    if not (transitions := chart_of(cls).transitions):
        return None
    flows = [_fact_flow(fact, cls) for one in transitions for fact in filter(callable, (one.when, one.after))]
    return ComponentPart(
        name="modes",
        when="on a change of a guard",
        is_ensemble=False,
        adaptation=True,
        reads=_union(one.read("self") for one in flows),
        writes=(MODE,),
        unknowns=_union(one.unknowns for one in flows),
    )


def methods(kind: EnsembleType) -> Iterator[Method]:
    """Yield the methods of an ensemble that use knowledge."""
    roles = ((COORDINATOR, kind.coordinator), (MEMBER, kind.member))
    local = (COORDINATOR,) if is_component(kind.coordinator) else (COORDINATOR, MEMBER)
    yield Method(_MEMBERSHIP, roles, kind.ports, (MEMBER,) if is_component(kind.member) else local)
    for name, exchange in kind.exchanges.items():
        classes = {exchange.side: exchange.own}
        if name == AT_GROUP:
            classes |= {role: one.role for role, one in kind.members.items()}
        elif name != PRIORITY:
            classes[MEMBER if exchange.side == COORDINATOR else COORDINATOR] = exchange.peer
        yield Method(name, tuple(sorted(classes.items())), exchange.ports, (exchange.side,))
    if kind.boundary:
        sides = (("sender", kind.boundary[0]), ("here", kind.boundary[1]))
        yield Method(_BOUNDARY, sides, (), ("here",))


def method_flow(ensemble: type, method: Method, local: str = "", cls: type[Knowledge] | None = None) -> Flow:
    """Analyse a method; `cls`, if given, is the class of the side `local`."""
    function = getattr(ensemble, method.name)
    subjects: dict[str, type] = {"self": ensemble, **dict(method.sides)}
    if cls is not None:
        subjects[local] = cls
    return analyse_flow(function, subjects, returns_knowledge=method.name.startswith("at_"))


def ensemble_part(ensemble: type, cls: type[Knowledge]) -> ComponentPart | None:
    """Return an ensemble as used by components of a class; None if they can be on neither side."""
    kind = ensemble_type(ensemble)
    assert kind is not None
    own: list[tuple[Method, str, list[str], Flow]] = []
    read_by_peers: list[tuple[str, ...]] = []
    for method in methods(kind):
        sides = dict(method.sides)
        for local in method.local:
            peers = [side for side in sides if side != local]
            if issubclass(cls, sides[local]):
                own.append((method, local, peers, method_flow(ensemble, method, local, cls)))
            for peer in peers:
                if issubclass(cls, sides[peer]):
                    read_by_peers.append(method_flow(ensemble, method).read(peer))
    watched = [_fact_flow(fact, cls) for fact in kind.on_change if own and has_fact(cls, fact)]
    if not own and not read_by_peers:
        return None
    return ComponentPart(
        name=kind.name,
        when=rhythm_of(kind),
        is_ensemble=True,
        adaptation=True,
        ports=tuple(dict.fromkeys(port for method, *_ in own for port in method.ports)),
        reads=_union(
            [*(found.read(local) for _, local, _, found in own), *(w.read("self") for w in watched)]
        ),
        writes=_union([*(found.written(local) for _, local, _, found in own), _agreed(kind, cls)]),
        peer_reads=_union(found.read(peer) for _, _, peers, found in own for peer in peers),
        read_by_peers=_union(read_by_peers),
        unknowns=_union([*(found.unknowns for *_, found in own), *(one.unknowns for one in watched)]),
    )


def _agreed(kind: EnsembleType, cls: type[Knowledge]) -> list[str]:
    """Return the fields that the node writes in a group."""
    fields = {"group_offers": kind.coordinator, "group_confirmations": kind.member}
    return [name for name, one in fields.items() if kind.members and issubclass(cls, one)]


def rhythm_of(kind: EnsembleType) -> str:
    """Return the schedule of an ensemble as text."""
    times = [_rhythm(PeriodicTrigger(kind.every, kind.offset))] if kind.every is not None else []
    times += [_change(kind.on_change)] if kind.on_change else []
    age = "" if kind.max_age is None else f", with replicas of at most {in_seconds(kind.max_age):g} s"
    return " and ".join(times) + age


def _rhythm(schedule: PeriodicTrigger) -> str:
    text = f"every {in_seconds(schedule.every):g} s"
    if schedule.offset:
        text += f" from {in_seconds(schedule.offset):g} s on"
    return text + (f", order {schedule.order}" if schedule.order else "")


def _change(facts: tuple[Fact, ...]) -> str:
    return "on a change of " + " or ".join(fact.__name__ for fact in facts)


def _fact_flow(fact: Fact, cls: type[Knowledge]) -> Flow:
    """Analyse a fact as defined or overridden by the class."""
    function = getattr(cls, fact.__name__)
    own = next(iter(inspect.signature(function).parameters))
    found = analyse_flow(function, {own: cls})
    return Flow({"self": dict.fromkeys(found.read(own))}, {}, found.unknowns)


def _union(many: Iterable[Iterable[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(one for some in many for one in some))
