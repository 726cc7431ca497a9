"""A robot's trajectory, cut so that drawing it for hours costs little."""

from typing import Final, NamedTuple

from actors.geometry import Point

RECENT: Final = 64
"""Points that are sent anew with every picture."""
PIECE: Final = 1024
"""Points of a piece; only the last piece is sent anew, whenever RECENT points have come together."""


class Strip(NamedTuple):
    """Points to be drawn, joined by lines, in place of what `name` showed before."""

    name: str
    points: tuple[Point, ...]


class Trail:
    """The points that a robot has passed; what is sent grows linearly with the way driven."""

    def __init__(self, spacing: float, jump: float) -> None:
        self._spacing = spacing
        self._jump = jump
        self._piece = 0
        self._past: list[Point] = []
        self._recent: list[Point] = []

    def extend(self, point: Point) -> list[Strip]:
        """The strips that change when the robot is at `point`; often none."""
        if not self._recent:
            self._recent = [point]
            return []
        gone = self._recent[-1].distance_to(point)
        if gone < self._spacing:
            return []
        if gone > self._jump:
            strips = [self._fold(), Strip("recent", ())]
            self._piece += 1
            self._past, self._recent = [], [point]
            return strips
        self._recent.append(point)
        if len(self._recent) < RECENT:
            return [Strip("recent", tuple(self._recent))]
        strips = [self._fold(), Strip("recent", ())]
        if len(self._past) >= PIECE:
            self._piece += 1
            self._past = []
        self._recent = [point]
        return strips

    def _fold(self) -> Strip:
        """Add what is recent to the piece."""
        self._past += self._recent[1:] if self._past else self._recent
        return Strip(str(self._piece), tuple(self._past))
