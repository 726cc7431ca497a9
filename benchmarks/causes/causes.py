"""Plants causes, and counts how often the accounting names them, in situations with one each and none."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from rich.table import Table

from benchmarks.causes.situations import PLANTED, Situation, quiet
from benchmarks.statistics.measured import Measured, proportion
from benchmarks.statistics.runs import in_memory, in_order
from observation.accounting.account import account
from observation.accounting.time_spent import Cause, DeadlockCount, TimeSpent

_NAMED: Final = 0.95
"""At least this share of the planted causes is to be named."""
_JUDGED_FROM: Final = 1001
"""The first seed that is judged; all numbers of the accounting were chosen with seeds below."""
_LEAST_S: Final = 3.0
"""A planted cause is named if it has so much of the robot's time."""
_WELL: Final = frozenset({Cause.DRIVING, Cause.IDLE, Cause.OFF, Cause.FROZEN})
"""What a robot spends its time with whom nothing keeps from getting on."""


@dataclass(frozen=True)
class SituationVerdict:
    """What was made of one situation."""

    kind: str
    seed: int
    named: bool
    """What was planted is named; of a quiet one: something was invented."""
    says: str
    """What the accounting says, shortly."""


def check(runs: int = 200, seed: int = _JUDGED_FROM) -> Measured:
    """Judge so many situations with a planted cause and as many quiet ones.

    Their seeds count from `seed`. It holds where nothing is invented in quiet ones and nearly all that was
    planted is named.
    """
    each = -(-runs // len(PLANTED))
    situations = [plant(seed) for seed in range(seed, seed + each) for plant in PLANTED][:runs]
    situations += [quiet(seed) for seed in range(seed, seed + runs)]
    verdicts = list(in_order(judge, situations))
    invented = sum(one.named for one in verdicts if one.kind == "quiet")
    named = sum(one.named for one in verdicts if one.kind != "quiet")
    holds = not invented and named >= _NAMED * runs
    return Measured([asdict(one) for one in verdicts], (_table(verdicts), *_wrong(verdicts)), holds)


def judge(situation: Situation) -> SituationVerdict:
    """Run the situation, and see what is said of it."""
    with in_memory(situation.scenario()) as (plan, _):
        spent = account(plan.out)
    named = _invented(spent) if situation.kind == "quiet" else _named(situation, spent)
    return SituationVerdict(situation.kind, situation.seed, named, _shortly(spent))


def _named(situation: Situation, spent: TimeSpent) -> bool:
    """What was planted has most of the time in which its robots did not get on, or is found."""
    if situation.found:
        return any(one.name == situation.found and one.robots == ("r1",) for one in spent.findings)
    return all(_mostly(spent.robots[robot], cause) for robot, cause in situation.expected.items())


def _mostly(lasted: Mapping[str, float], cause: Cause) -> bool:
    kept = {name: s for name, s in lasted.items() if Cause(name) not in _WELL}
    return kept[cause.value] >= _LEAST_S and kept[cause.value] == max(kept.values())


def _invented(spent: TimeSpent) -> bool:
    strange = any(s for each in spent.robots.values() for name, s in each.items() if Cause(name) not in _WELL)
    return strange or bool(spent.blockings) or bool(spent.findings) or spent.deadlocks != DeadlockCount(0, 0)


def _shortly(spent: TimeSpent) -> str:
    times = (
        f"{robot}: " + ", ".join(f"{cause} {s:g} s" for cause, s in each.items() if s)
        for robot, each in spent.robots.items()
    )
    return "; ".join([*times, *(one.says for one in spent.findings)])


def _table(verdicts: Sequence[SituationVerdict]) -> Table:
    by_kind: dict[str, list[SituationVerdict]] = defaultdict(list)
    for one in verdicts:
        by_kind[one.kind].append(one)
    planted = [one for one in verdicts if one.kind != "quiet"]
    table = Table("situation", "runs", "named", "95 %")
    rows = {**by_kind, "all planted": planted, "quiet: something invented": by_kind.pop("quiet")}
    for name, group in rows.items():
        if name != "quiet":
            share = proportion(sum(one.named for one in group), len(group))
            named = str(sum(one.named for one in group))
            table.add_row(name, str(len(group)), named, f"{share.low:.1%} to {share.high:.1%}")
    return table


def _wrong(verdicts: Sequence[SituationVerdict]) -> Iterator[str]:
    for one in verdicts:
        if one.named == (one.kind == "quiet"):
            yield f"{one.kind}, seed {one.seed}: {one.says}"
