"""What is due next: a binary heap over records (Knuth, "The Art of Computer Programming" 3, 5.2.3)."""

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit


@njit(cache=True)  # type: ignore[untyped-decorator]
def push(agenda: NDArray[np.void], size: int, instant: int, order: int, ticket: int) -> int:
    """Put an entry into a heap of so many; the new size."""
    place = size
    while place > 0:
        above = (place - 1) >> 1
        entry = agenda[above]
        if entry.instant_ns < instant or (entry.instant_ns == instant and entry.order <= order):
            break
        agenda[place].instant_ns = entry.instant_ns
        agenda[place].order = entry.order
        agenda[place].ticket = entry.ticket
        place = above
    agenda[place].instant_ns = instant
    agenda[place].order = order
    agenda[place].ticket = ticket
    return size + 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def pop(agenda: NDArray[np.void], size: int) -> int:
    """Take the first entry out of a heap of so many, at least one; the new size."""
    size -= 1
    instant, order, ticket = agenda[size].instant_ns, agenda[size].order, agenda[size].ticket
    place = 0
    while True:
        below = 2 * place + 1
        if below >= size:
            break
        entry = agenda[below]
        if below + 1 < size:
            other = agenda[below + 1]
            if other.instant_ns < entry.instant_ns or (
                other.instant_ns == entry.instant_ns and other.order < entry.order
            ):
                below += 1
                entry = other
        if instant < entry.instant_ns or (instant == entry.instant_ns and order <= entry.order):
            break
        agenda[place].instant_ns = entry.instant_ns
        agenda[place].order = entry.order
        agenda[place].ticket = entry.ticket
        place = below
    agenda[place].instant_ns = instant
    agenda[place].order = order
    agenda[place].ticket = ticket
    return size
