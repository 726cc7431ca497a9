"""The table of docs/isolation.md; `python -m benchmarks.attacks.table` prints it."""

import sys

from benchmarks.attacks.attack import Layer
from benchmarks.attacks.attacks import ATTACKS


def table() -> str:
    """One line per attack, in Markdown."""
    lines = ["| way to a peer | closed by | with `--no-isolate` |", "|---|---|---|"]
    for attack in ATTACKS:
        if attack.layer != Layer.NONE:
            without = "closed" if attack.layer <= Layer.RULES else "open"
            lines.append(f"| {attack.name} | {attack.closed_by} | {without} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(f"{table()}\n")
