"""One claim: what it says, what came of holding it against something, and what checks it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final

from benchmarks.statistics.measured import Measured

OWN_DATA: Final = frozenset({"cell", "data", "log", "source"})
"""Settings that say on what is to be checked: who gives one gets the full size, unless he says another."""


@dataclass(frozen=True)
class PublishedClaim:
    """A row of the page, and a word of `acrc verify`."""

    name: str
    part: str
    """The page's heading above it."""
    says: str
    """Markdown, as the next one."""
    result: str
    module: str = ""
    """Has the function `check`, which gives `Measured`; empty: nothing checks it by itself."""
    command: str = ""
    """What shows it where nothing checks it by itself."""
    small: Mapping[str, Any] = field(default_factory=dict)
    """Settings of `check` that take seconds."""
    full: Mapping[str, Any] = field(default_factory=dict)
    """Those that the page's result is of."""
    seconds: tuple[int, int] = (0, 0)
    """About what the small and the full size take on two cores."""
    takes: tuple[str, ...] = ()
    """Settings of `check` that can be given on the command line."""

    def settings(self, given: Mapping[str, Any], *, full: bool) -> dict[str, Any]:
        """What `check` is called with: the size's settings, and above them what was given."""
        size = self.full if full or not OWN_DATA.isdisjoint(given) else self.small
        return {**size, **given}

    def check(self, settings: Mapping[str, Any]) -> Measured:
        """Check it. AcrcError where it cannot be."""
        found: Measured = import_module(self.module).check(**settings)
        return found
