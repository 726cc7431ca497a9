"""The table of docs/isolation.md; `python -m tests.isolation.table` prints it."""

from tests.isolation.attack import Layer
from tests.isolation.attacks import ATTACKS


def table() -> str:
    """One line per attack, in Markdown."""
    lines = ["| way to a peer | closed by | with `--no-isolate` |", "|---|---|---|"]
    for attack in ATTACKS:
        if attack.layer != Layer.NONE:
            without = "closed" if attack.layer <= Layer.RULES else "open"
            lines.append(f"| {attack.name} | {attack.closed_by} | {without} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
