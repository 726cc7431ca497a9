"""Comparison of two campaign folders by digests and results: `python3 check_digests.py RESULTS AGAIN`.

Part of every bundle; needs only Python.
"""

import json
import sys
from pathlib import Path

COMPARED_FIELDS = ("digest", "task", "contacts", "people_contacts", "people_contact_s", "metrics")
"""Values compared; the digest covers messages only, not results computed from them."""


def results(folder: Path) -> dict[str, dict[str, object]]:
    """Return the values of every run by file name; None for failed runs."""
    runs = {}
    for path in sorted((folder / "trials").glob("*.json")):
        result = json.loads(path.read_bytes())["result"] or {}
        runs[path.name] = {name: result.get(name) for name in COMPARED_FIELDS}
    return runs


def main(before_folder: str, repeated_folder: str) -> int:
    """Print differences; return 0 if all repeated runs are equal, else 1."""
    before, now = results(Path(before_folder)), results(Path(repeated_folder))
    both = sorted(before.keys() & now.keys())
    different = [
        (run, name) for run in both for name in COMPARED_FIELDS if before[run][name] != now[run][name]
    ]
    differences = [f"{run}: {name} was {before[run][name]}, is {now[run][name]}" for run, name in different]
    same = f"{len(both) - len({run for run, _ in different})} of {len(both)} repeated runs are identical"
    sys.stdout.write("\n".join([*differences, f"{same}; the results have {len(before)} runs", ""]))
    return 0 if both and not different else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
