"""The counts that a change is held to: a file for one version of Python, read, written, compared."""

import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Final

from benchmarks.swarm.counted.in_memory import StepCounts
from deploy.scenario.toml_text import document

TABLE: Final = Path(__file__).with_name("python{}.{}.toml".format(*sys.version_info))
"""That of this Python, which need not be there: another version calls other functions."""
TOLERANCE: Final = 0.02
"""By so much may a sum differ from the table's."""
KEPT: Final = {
    "calls": "Python calls",
    "messages": "messages",
    "sent": "bytes sent",
    "recorded": "bytes recorded",
}
"""What stands in the table and is compared, in words."""
_LEAST: Final = 0.0005
_NAMED: Final = 5
"""So many rooms are named as the cause, at most."""
_DIGITS: Final = 3
_HEAD: Final = (
    "# What one robot costs in one step, counted. `acrc bench budget` shows it, and with --write it writes\n"
    "# this file. A commit that changes it says why a step costs more, or less.\n\n"
)


def written(counts: StepCounts) -> str:
    """The text of the file; what is next to nothing is left out."""
    tables = {
        name: {one: round(value, _DIGITS) for one, value in getattr(counts, name).items() if value >= _LEAST}
        for name in KEPT
    }
    return _HEAD + document(tables)


def read() -> StepCounts | None:
    """What the file of this Python keeps, without functions; None if there is no such file."""
    if not TABLE.is_file():
        return None
    content = tomllib.loads(TABLE.read_text())
    return StepCounts(**{field.name: content.get(field.name, {}) for field in fields(StepCounts)})


def differences(now: StepCounts, kept: StepCounts) -> Iterator[str]:
    """A sentence for each sum that differs by more than TOLERANCE, with the names where it does."""
    for name, words in KEPT.items():
        new, old = getattr(now, name), getattr(kept, name)
        change = sum(new.values()) / sum(old.values()) - 1
        if abs(change) > TOLERANCE:
            yield (
                f"a robot-step has {sum(new.values()):.1f} {words}, {TABLE.name} keeps "
                f"{sum(old.values()):.1f} ({change:+.1%}): {_causes(new, old)}; if that is meant, "
                "`acrc bench budget --write` keeps it, and the commit says why"
            )


def _causes(new: Mapping[str, float], old: Mapping[str, float]) -> str:
    """Where it differs most, the greatest difference first."""
    changes = {name: new.get(name, 0.0) - old.get(name, 0.0) for name in {**old, **new}}
    most = sorted(changes, key=lambda name: -abs(changes[name]))[:_NAMED]
    return ", ".join(f"{name} {changes[name]:+.1f}" for name in most if abs(changes[name]) >= 0.05)
