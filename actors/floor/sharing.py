"""What follows from content alone is made once, and shared by whoever asks for the same while it lives."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar
from weakref import WeakValueDictionary

V = TypeVar("V")


class Shared(Generic[V]):
    """Values that never change, by all that they follow from; each only for as long as somebody holds it.

    So a process that asks once pays for nothing it does not keep, and one that starts many robots has only to
    hold what the first of them needed: the others, and those that it forks, find that.
    """

    def __init__(self) -> None:
        self._known: WeakValueDictionary[Hashable, V] = WeakValueDictionary()

    def get(self, content: Hashable, make: Callable[[], V]) -> V:
        """The value that follows from `content`: a living one, or a new one by `make`."""
        value = self._known.get(content)
        if value is None:
            value = self._known[content] = make()
        return value
