"""Every attack on a swarm of two, and on one over two hosts: what held, and if the rest is documented."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.table import Table

from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import available
from benchmarks.attacks.attack import Attack, Layer, missing_means
from benchmarks.attacks.attacked_hosts import AttackedHosts, attacked_hosts
from benchmarks.attacks.attacks import ATTACKS, row
from benchmarks.attacks.host_attacks import HOST_ATTACKS
from benchmarks.attacks.network_attacks import REPOSITORY
from benchmarks.attacks.swarm import AttackedSwarm
from benchmarks.statistics.measured import Measured

DOCUMENT: Final = REPOSITORY / "docs" / "isolation.md"


class AttacksError(AcrcError):
    """Attacks that cannot be carried out."""


@dataclass(frozen=True)
class AttackVerdict:
    """What came of one attack."""

    name: str
    closed_by: str
    outcome: str
    """"held", "through", or why it was not tried."""
    stated: bool
    """Whether the documentation says that it gets through."""


def check() -> Measured:
    """Carry out all attacks on isolated robots, and those on links between computers.

    It holds where every attack that gets through is one that the documentation owns up to. Raises
    AttacksError where robots cannot be isolated.
    """
    reason = available()
    if reason is not None:
        raise AttacksError(reason)
    with AttackedSwarm("isolated") as swarm:
        verdicts = list(_verdicts(swarm, DOCUMENT))
    with attacked_hosts() as hosts:
        verdicts += _host_verdicts(hosts)
    return told(verdicts)


def told(verdicts: Sequence[AttackVerdict]) -> Measured:
    """What the attacks came to, and which got through although the documentation does not say so."""
    table = Table("attack", "closed by", "outcome")
    for verdict in verdicts:
        stated = ", as stated" if verdict.stated else ""
        table.add_row(verdict.name, verdict.closed_by, f"{verdict.outcome}{stated}")
    through = [verdict for verdict in verdicts if verdict.outcome == "through"]
    held = sum(verdict.outcome == "held" for verdict in verdicts)
    unstated = [verdict.name for verdict in through if not verdict.stated]
    sentences = [
        f"{len(verdicts)} attacks: {held} held, {len(through)} through, of which {len(unstated)} unstated; "
        f"{len(verdicts) - held - len(through)} not tried"
    ]
    if unstated:
        sentences.append(f"through, and {DOCUMENT.name} does not say so: {'; '.join(unstated)}")
    return Measured([asdict(verdict) for verdict in verdicts], (table, *sentences), not unstated)


def is_stated(attack: Attack, text: str) -> bool:
    """Whether the documentation `text` says that nothing closes this way."""
    return attack.layer == Layer.REMAINS and row(attack) in text


def _host_verdicts(hosts: AttackedHosts) -> Iterator[AttackVerdict]:
    for attack in HOST_ATTACKS:
        reached = attack.act(hosts)
        if not attack.control:
            outcome = "through" if reached else "held"
            yield AttackVerdict(attack.name, attack.closed_by, outcome, stated=False)
        elif not reached:
            raise AttacksError(f"{attack.name}: must get through, and does not: nobody hears anybody here")


def _verdicts(swarm: AttackedSwarm, document: Path) -> Iterator[AttackVerdict]:
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
