"""Upon which knowledge a change depends, as the source of the process or exchange tells."""

import inspect
from typing import NamedTuple

from deeco.explain.anatomy import ensemble_type, method_flow, methods
from deeco.explain.dataflow import flow
from deeco.knowledge import Knowledge


class Dependence(NamedTuple):
    """What a process or an exchange reads."""

    own: tuple[str, ...]
    """Fields of the component's own."""
    peer: tuple[str, ...]
    """Fields of the peer, for an exchange."""


def dependence(
    kind: type[Knowledge], by: str, ensembles: tuple[object, ...], *, exchange: bool
) -> Dependence:
    """What is read by the process or exchange `by` of a component; nothing where the source does not say."""
    owner, _, name = by.rpartition(".")
    if not exchange:
        function = getattr(kind, name, None)
        if function is None:
            return Dependence((), ())
        own = next(iter(inspect.signature(function).parameters))
        return Dependence(flow(function, {own: kind}).read(own), ())
    for one in ensembles:
        described = ensemble_type(type(one))
        if described is not None and described.name == owner:
            return _of_exchange(type(one), name, kind)
    return Dependence((), ())


def _of_exchange(ensemble: type, name: str, kind: type[Knowledge]) -> Dependence:
    """Membership and exchange together: both had to agree."""
    described = ensemble_type(ensemble)
    assert described is not None
    local = name.removeprefix("at_")
    own: dict[str, None] = {}
    peer: dict[str, None] = {}
    for method in methods(described):
        if method.name not in ("membership", name):
            continue
        found = method_flow(ensemble, method, local, kind)
        other = next(side for side, _ in method.sides if side != local)
        own |= dict.fromkeys(found.read(local))
        peer |= dict.fromkeys(found.read(other))
    return Dependence(tuple(own), tuple(peer))
