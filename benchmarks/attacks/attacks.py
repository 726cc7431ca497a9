"""All attacks; `python -m benchmarks.attacks.attacks` prints the table of docs/isolation.md."""

import sys

from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.bus_attacks import BUS_ATTACKS, CONTROLS
from benchmarks.attacks.counter_attacks import COUNTER_ATTACKS
from benchmarks.attacks.file_attacks import FILE_ATTACKS
from benchmarks.attacks.memory_attacks import MEMORY_ATTACKS
from benchmarks.attacks.network_attacks import NETWORK_ATTACKS
from benchmarks.attacks.process_attacks import PROCESS_ATTACKS

ATTACKS = (
    *(*CONTROLS, *BUS_ATTACKS, *NETWORK_ATTACKS, *FILE_ATTACKS, *MEMORY_ATTACKS),
    *(*COUNTER_ATTACKS, *PROCESS_ATTACKS),
)


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
