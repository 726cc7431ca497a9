"""Every attack on a swarm of two: what held, what got through, and whether the documentation says so."""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import available
from benchmarks.attacks.attack import Attack, Layer, missing_means
from benchmarks.attacks.attacks import ATTACKS
from benchmarks.attacks.network_attacks import REPOSITORY
from benchmarks.attacks.swarm import Swarm
from benchmarks.attacks.table import row

DOCUMENT: Final = REPOSITORY / "docs" / "isolation.md"


class AttacksError(AcrcError):
    """Attacks that cannot be carried out, or one that got through unstated."""


@dataclass(frozen=True)
class AttackVerdict:
    """What came of one attack."""

    name: str
    closed_by: str
    outcome: str
    """"held", "through", or why it was not tried."""
    stated: bool
    """Whether the documentation says that it gets through."""


def run(json_output: bool = False) -> list[AttackVerdict]:
    """Carry out all attacks on isolated robots and print what came of them.

    Raises AttacksError where robots cannot be isolated, and for an attack that gets through unstated.
    """
    reason = available()
    if reason is not None:
        raise AttacksError(reason)
    with Swarm("isolated") as swarm:
        verdicts = list(_verdicts(swarm, DOCUMENT))
    if json_output:
        sys.stdout.write(json.dumps([asdict(verdict) for verdict in verdicts], indent=1) + "\n")
    else:
        _print(verdicts)
    judge(verdicts)
    return verdicts


def judge(verdicts: Sequence[AttackVerdict]) -> None:
    """Raise AttacksError where an attack got through that the documentation does not own up to."""
    unstated = [verdict.name for verdict in verdicts if verdict.outcome == "through" and not verdict.stated]
    if unstated:
        raise AttacksError(f"through, and {DOCUMENT.name} does not say so: {'; '.join(unstated)}")


def is_stated(attack: Attack, text: str) -> bool:
    """Whether the documentation `text` says that nothing closes this way."""
    return attack.layer == Layer.REMAINS and row(attack) in text


def _verdicts(swarm: Swarm, document: Path) -> Iterator[AttackVerdict]:
    text = document.read_text("utf-8")
    for index, attack in enumerate(ATTACKS):
        why_not = missing_means(attack)
        reached = why_not is None and swarm.carry_out(index).reached
        if attack.layer == Layer.NONE:
            if not reached:
                raise AttacksError(
                    f"{attack.name}: must get through, and does not: nobody hears anybody here"
                )
            continue
        outcome = why_not or ("through" if reached else "held")
        yield AttackVerdict(attack.name, attack.closed_by, outcome, is_stated(attack, text))


def _print(verdicts: Sequence[AttackVerdict]) -> None:
    table = Table("attack", "closed by", "outcome")
    for verdict in verdicts:
        stated = ", as stated" if verdict.stated else ""
        table.add_row(verdict.name, verdict.closed_by, f"{verdict.outcome}{stated}")
    through = [verdict for verdict in verdicts if verdict.outcome == "through"]
    held = sum(verdict.outcome == "held" for verdict in verdicts)
    console = Console()
    console.print(table, highlight=False, markup=False)
    console.print(
        f"{len(verdicts)} attacks: {held} held, {len(through)} through, of which "
        f"{sum(not verdict.stated for verdict in through)} unstated; "
        f"{len(verdicts) - held - len(through)} not tried",
        highlight=False,
    )
