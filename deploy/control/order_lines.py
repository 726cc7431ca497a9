"""The orders that pages gave, told in lines, and what became of them."""

from collections import deque
from typing import Final

import msgspec

from deploy.control.wire import Ask, OrderLine

KEPT: Final = 100
"""Lines; older ones are forgotten."""


class OrderLines:
    """The last lines, oldest first. Equal orders in a row are one line, and so are those of one series."""

    def __init__(self) -> None:
        self._lines: deque[OrderLine] = deque(maxlen=KEPT)
        self._series = 0
        """Of the newest line."""
        self._begun = 0
        self._fresh: dict[int, OrderLine] = {}

    def begin(self, wish: Ask) -> int:
        """Take in an order that waits for its answer; the number of its line."""
        last = self._lines[-1] if self._lines else None
        together = last is not None and (
            wish.order == last.order or (wish.series != 0 and wish.series == self._series)
        )
        self._series = wish.series
        if last is not None and together:
            line = msgspec.structs.replace(
                last, order=wish.order, times=last.times + 1, waiting=last.waiting + 1
            )
            self._lines[-1] = line
        else:
            self._begun += 1
            line = OrderLine(self._begun, wish.order, waiting=1)
            self._lines.append(line)
        self._fresh[line.number] = line
        return line.number

    def end(self, number: int, refusal: str) -> None:
        """Note what became of an order of this line; an empty refusal: it was carried out."""
        place = number - self._begun - 1
        if -place > len(self._lines):
            return
        line = self._lines[place]
        self._lines[place] = self._fresh[number] = msgspec.structs.replace(
            line,
            waiting=line.waiting - 1,
            refused=line.refused + bool(refusal),
            refusal=refusal or line.refusal,
        )

    def kept(self) -> tuple[OrderLine, ...]:
        """All lines, oldest first."""
        return tuple(self._lines)

    def fresh(self) -> tuple[OrderLine, ...]:
        """The lines that have changed since this was asked last."""
        fresh = tuple(self._fresh.values())
        self._fresh.clear()
        return fresh
