"""View files of rerun, read back without a window."""

from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

Rows = dict[str, list[dict[str, Any]]]


def rows(path: Path) -> Rows:
    """Return everything that was logged, by entity, in the order of time; static rows have no sim_time."""
    found: Rows = {}
    for chunk in RrdReader(str(path)).stream():
        found.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pylist())
    for some in found.values():
        some.sort(key=lambda row: row["sim_time"].total_seconds() if "sim_time" in row else -1.0)
    return found


def timed(some: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows that have a time."""
    return [row for row in some if "sim_time" in row]
