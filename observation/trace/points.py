"""Which changes of knowledge brought a point into a robot's knowledge, and which took it away."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass

from actors.geometry import Point


class KnownPoints:
    """Follows the points in a component's fields, change by change."""

    def __init__(self) -> None:
        self._brought: dict[Point, dict[str, int]] = defaultdict(dict)
        self._taken: dict[Point, dict[str, int]] = defaultdict(dict)
        """By point the number of the last change of each field."""
        self._step = -1
        self._kept: dict[Point, dict[str, int]] = defaultdict(dict)
        """The same of points that a change of the last step has left in a field."""

    def note(self, number: int, step: int, field: str, before: object, after: object) -> None:
        """A change of a field."""
        if step != self._step:
            self._step = step
            self._kept.clear()
        had, has = set(_points(before)), set(_points(after))
        for point in has - had:
            self._brought[point][field] = number
        for point in had - has:
            self._taken[point][field] = number
        for point in has:
            self._kept[point][field] = number

    def behind(self, point: Point | None, step: int, *, gone: bool, again: bool) -> tuple[int, ...]:
        """The last change of each field that brought the point, newest first.

        `gone`: that took it away; `again`: also those of this step that have left it in the field.
        """
        if point is None:
            return ()
        found = dict((self._taken if gone else self._brought).get(point, {}))
        if again and step == self._step:
            found |= self._kept.get(point, {})
        return tuple(sorted(set(found.values()), reverse=True))


def _points(value: object) -> Iterator[Point]:
    """Every point that is somewhere in the value."""
    if isinstance(value, Point):
        yield value
    elif isinstance(value, tuple):
        if len(value) == 2 and all(isinstance(one, float) for one in value):
            yield Point(*value)
        for one in value:
            yield from _points(one)
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _points(one)
    elif is_dataclass(value):
        for one in fields(value):
            yield from _points(getattr(value, one.name))
