"""Who has held up the steps of a run, as seen from outside: by its own doing, not by the machine's."""

from collections.abc import Iterator, Mapping

import msgspec


class HoldUp(msgspec.Struct, frozen=True):
    """What one actor has cost its run: time in which nobody else could go on, and that it spent itself."""

    steps: int = 0
    """Steps that it held up by a second or more."""
    most_s: float = 0.0
    """The longest of them, s of wall clock."""
    total_s: float = 0.0
    """All of them together, s of wall clock."""

    def and_one(self, lasted_s: float) -> "HoldUp":
        """With one more."""
        return HoldUp(self.steps + 1, max(self.most_s, lasted_s), self.total_s + lasted_s)


def sentences(held_up: Mapping[str, HoldUp]) -> Iterator[str]:
    """Who has held up the run, the longest first."""
    for name, one in sorted(held_up.items(), key=lambda item: -item[1].total_s):
        steps = "1 step" if one.steps == 1 else f"{one.steps} steps"
        yield f"{name} held up {steps}, by {one.most_s:.1f} s at most, {one.total_s:.1f} s in all."
