"""Compares the runs of two campaign folders by their digests: `python3 check_digests.py RESULTS AGAIN`.

It stands in every bundle, so it needs nothing but Python.
"""

import json
import sys
from pathlib import Path


def digests(folder: Path) -> dict[str, str | None]:
    """Of every run, by the name of its file; None of one that failed."""
    found = {}
    for path in sorted((folder / "trials").glob("*.json")):
        result = json.loads(path.read_bytes())["result"]
        found[path.name] = None if result is None else result["digest"]
    return found


def main(results: str, again: str) -> int:
    """Print what differs; 0 if every run that was made again came out as before, else 1."""
    before, now = digests(Path(results)), digests(Path(again))
    both = sorted(before.keys() & now.keys())
    different = [name for name in both if before[name] != now[name]]
    told = [f"{name}: was {before[name] or 'a failure'}, is {now[name] or 'a failure'}" for name in different]
    same = f"{len(both) - len(different)} of {len(both)} runs that were made again have the same digest"
    sys.stdout.write("\n".join([*told, f"{same}; {len(before)} are in the results", ""]))
    return 0 if both and not different else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
