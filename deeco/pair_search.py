"""Search for the pairs of components that fulfil the declared conditions of an ensemble.

    @ensemble(every=seconds(1), equal=("room", "office"), near=("position", 3.0))

Positions are compared by the cells of a grid: near components are in the same cell or in neighbouring ones.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from typing import Any, Final, get_origin, get_type_hints

from deeco.errors import DefinitionError

Equal = tuple[str, str] | None
"""Fields of coordinator and member with equal values."""
Near = tuple[str, float | str] | None
"""Field of both with the position, and the maximum distance or the ensemble's field with it."""
_SLACK: Final = 1.001
"""Size of a cell relative to the distance: exceeds the rounding errors of computed distances."""


def check_conditions(where: str, kinds: tuple[type, type], equal: Equal, near: Near) -> None:
    """Raise DefinitionError unless coordinator and member have the fields of the conditions."""
    for side, kind in enumerate(kinds):
        hints = get_type_hints(kind)
        if equal and equal[side] not in hints:
            raise DefinitionError(f"{where}: equal={equal}, but {kind.__name__} has no field {equal[side]!r}")
        position = hints.get(near[0]) if near else float
        plain = get_origin(position) or position
        if plain not in {float, tuple} and not hasattr(plain, "_fields"):
            raise DefinitionError(
                f"{where}: near={near}, but {kind.__name__} has no such field with a float or a tuple"
            )


class PairSearch:
    """Search for the pairs to evaluate, in the order of local components and peers."""

    def __init__(self, kind: Any, ensemble: object) -> None:
        """Create the search for an ensemble; `kind`: its EnsembleType.

        Raises DefinitionError for a wrong distance.
        """
        self._kinds = kind.coordinator, kind.member
        self._equal = kind.equal
        near: Near = kind.near
        self._field, limit = near or ("", 1.0)
        distance = getattr(ensemble, str(limit), limit)
        if not isinstance(distance, (int, float)) or not distance > 0:
            raise DefinitionError(
                f"ensemble {kind.name}: near has the distance {distance!r}; "
                "use a positive number or a field of the ensemble with one"
            )
        self._cell = distance * _SLACK

    def index(self, peers: Sequence[Any], members: Iterable[tuple[str, str]]) -> None:
        """Begin an evaluation with these peers; `members`: ids of further pairs to find."""
        self._peers = peers
        self._places = defaultdict[object, list[int]](list)
        by_id = {peer.id: place for place, peer in enumerate(peers)}
        for local, other in members:
            self._add(by_id[other], [local])
        for place, peer in enumerate(peers):
            self._add(place, self._keys(peer.role))

    def peers_of(self, place: int) -> Iterator[Any]:
        """Yield the peers of a local component, whose knowledge may change meanwhile."""
        local = self._peers[place]

        def own_role(kind: type) -> Any:
            return local.value if isinstance(local.value, kind) else None

        last = -1
        while True:
            keys = self._keys(own_role)
            found = {*self._places.get(local.id, ())}
            for side, equal, cell in keys:
                for around in product(*[(number - 1, number, number + 1) for number in cell]):
                    found.update(self._places.get((1 - side, equal, around), ()))
            for last in sorted(one for one in found if one > last and one != place):
                value = local.value
                yield self._peers[last]
                if local.value is not value and (changed := self._keys(own_role)) != keys:
                    self._add(place, changed)
                    break
            else:
                return

    def _add(self, place: int, keys: Iterable[object]) -> None:
        for key in keys:
            self._places[key].append(place)

    def _keys(self, role: Callable[[type], Any]) -> list[tuple[int, object, tuple[float, ...]]]:
        """Return the keys of a component as coordinator (0) and member (1): equal value and cell."""
        keys = []
        for side, kind in enumerate(self._kinds):
            if (value := role(kind)) is not None:
                position = getattr(value, self._field, ())
                coordinates = position[:2] if isinstance(position, tuple) else (position,)
                cell = tuple([one // self._cell for one in coordinates])
                keys.append((side, self._equal and getattr(value, self._equal[side]), cell))
        return keys
