"""Compares the runs of two campaign folders by digests and results: `python3 check_digests.py RESULTS AGAIN`.

It stands in every bundle, so it needs nothing but Python.
"""

import json
import sys
from pathlib import Path

NUMBERS = (
    "digest", "places_total", "places_done", "places_claimed", "places_given_up", "places_lost", "contacts",
    "completion_s", "settled_s",
)  # fmt: skip
"""What must come out again. A digest is of messages; what is made of them in the end has none."""


def results(folder: Path) -> dict[str, dict[str, object]]:
    """These of every run, by the name of its file; none of one that failed."""
    found = {}
    for path in sorted((folder / "trials").glob("*.json")):
        result = json.loads(path.read_bytes())["result"] or {}
        found[path.name] = {name: result.get(name) for name in NUMBERS}
    return found


def main(before_folder: str, again: str) -> int:
    """Print what differs; 0 if every run that was made again came out as before, else 1."""
    before, now = results(Path(before_folder)), results(Path(again))
    both = sorted(before.keys() & now.keys())
    different = [(run, name) for run in both for name in NUMBERS if before[run][name] != now[run][name]]
    told = [f"{run}: {name} was {before[run][name]}, is {now[run][name]}" for run, name in different]
    same = f"{len(both) - len({run for run, _ in different})} of {len(both)} runs that were made again came"
    sys.stdout.write("\n".join([*told, f"{same} out the same; {len(before)} are in the results", ""]))
    return 0 if both and not different else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
