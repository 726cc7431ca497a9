"""Modes of a component: some of its processes are active in some modes only.

    @component
    class Robot(Searcher):
        mode: Mode = Mode.SEARCH            # an Enum; the default is the initial mode
        charge: float = 1.0

        def is_low(self) -> bool: ...

        modes = ModeChart(
            Transition(Mode.SEARCH, Mode.CHARGE, when=is_low, after=seconds(2)),
            Transition(Mode.CHARGE, Mode.SEARCH, after=seconds(60)),
        )

        @periodic(every=seconds(1), modes=(Mode.SEARCH,))
        def search(self) -> Self: ...

A transition fires when its guard has held for `after` in its source mode without interruption.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from deeco.errors import DefinitionError
from deeco.instant import ZERO, Duration, Instant, check_duration, in_seconds
from deeco.knowledge import Fact, Knowledge, check_fact

Modes = tuple[Enum, ...]
MODE: Final = "mode"
"""Field with the current mode; only transitions change it."""


@dataclass(frozen=True, eq=False)
class Transition:
    """A change of the mode.

    `when`: guard; None: it always holds. `after`: time for which the guard must hold in `source`, or a method
    that returns it when the guard begins to hold.
    """

    source: Enum
    target: Enum
    when: Fact | None = None
    after: Duration | Callable[[Any], Duration] = ZERO

    def __post_init__(self) -> None:
        if not callable(self.after):
            check_duration(f"Transition {self.source} → {self.target}: after", self.after, zero=True)

    @property
    def condition(self) -> str:
        """Guard and time as text."""
        after = self.after.__name__ if callable(self.after) else f"{in_seconds(self.after):g} s"
        when = f"when {self.when.__name__} " if self.when else ""
        return (f"{when}after {after}" if self.after else when).strip()

    def deadline(self, value: Knowledge, now: Instant) -> Instant:
        """Return when it fires if its guard holds from now on."""
        after = getattr(value, self.after.__name__)() if callable(self.after) else self.after
        return Instant(now + after)


class ModeChart:
    """The transitions between a component's modes, by priority; assign it to `modes` in the class."""

    def __init__(self, *transitions: Transition) -> None:
        self.transitions = transitions

    def enabled(self, value: Knowledge) -> list[Transition]:
        """Return the transitions from the current mode whose guards hold, in order."""
        return [
            one
            for one in self.transitions
            if one.source is getattr(value, MODE)
            and (one.when is None or getattr(value, one.when.__name__)())
        ]


def chart_of(cls: type[Knowledge]) -> ModeChart:
    """Return the mode chart of a component class; one without transitions if it has no modes."""
    chart = getattr(cls, "modes", None)
    return chart if isinstance(chart, ModeChart) else ModeChart()


def check_modes(cls: type[Knowledge], active: Mapping[str, Modes]) -> None:
    """Raise DefinitionError unless a class's modes are valid; `active`: modes of restricted processes."""
    owner, transitions, initial = cls.__name__, chart_of(cls).transitions, getattr(cls, MODE, None)
    used = [(name, mode) for name, some in active.items() for mode in some]
    used += [("modes", mode) for one in transitions for mode in (one.source, one.target)]
    if not used:
        return
    if not (transitions and isinstance(initial, Enum) and MODE in cls.__dataclass_fields__):
        raise DefinitionError(
            f"{owner}.{used[0][0]} needs both modes = ModeChart(...) with transitions and a field with the "
            "initial mode, such as mode: Mode = Mode.SEARCH"
        )
    modes, reached = [*type(initial)], {initial}
    for name, mode in used:
        if mode not in modes:
            raise DefinitionError(f"{owner}.{name}: {mode!r} is not a mode; use one of {modes}")
    for one in transitions:
        for fact in filter(callable, (one.when, one.after)):
            check_fact(cls, fact, f"{owner}.modes: {one.source} → {one.target} uses")
    for _ in modes:
        reached |= {one.target for one in transitions if one.source in reached}
    if missing := [mode for mode in modes if mode not in reached]:
        raise DefinitionError(f"{owner}.modes: no transitions lead to {missing}; add some, or remove modes")
