"""The table of docs/isolation.md; `python -m benchmarks.attacks.table` prints it."""

import sys

from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.attacks import ATTACKS


def row(attack: Attack) -> str:
    """The line of one attack."""
    without = "closed" if attack.layer <= Layer.RULES else "open"
    return f"| {attack.name} | {attack.closed_by} | {without} |"


def table() -> str:
    """One line per attack, in Markdown."""
    lines = ["| way to a peer | closed by | with `--no-isolate` |", "|---|---|---|"]
    lines += [row(attack) for attack in ATTACKS if attack.layer != Layer.NONE]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(f"{table()}\n")
