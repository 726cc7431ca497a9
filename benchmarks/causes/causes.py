"""Plants causes, and counts how often the accounting names them, in situations with one each and none."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from rich.table import Table

from benchmarks.causes.situations import PLANTED, Situation, quiet
from benchmarks.statistics.measured import Measured, proportion
from benchmarks.statistics.runs import in_memory, in_order
from observation.accounting.account import account
from observation.accounting.findings import CARRIED, JAMMED
from observation.accounting.time_spent import Cause, TimeSpent

_NAMED: Final = 0.9
"""At least this share of the planted causes is to be named; some runs are over before theirs shows."""
_LEAST_S: Final = 3.0
"""A planted cause is named if it has so much of the robot's time."""
_EXPECTED: Final = frozenset({Cause.DRIVING, Cause.IDLE})
"""What the robots of a quiet situation spend their time with."""


@dataclass(frozen=True)
class SituationVerdict:
    """What was made of one situation."""

    kind: str
    seed: int
    named: bool
    """What was planted is named; of a quiet one: something was invented."""
    says: str
    """What the accounting says, shortly."""


def check(runs: int = 200) -> Measured:
    """Judge so many situations with a planted cause and as many quiet ones.

    It holds where nothing is invented in quiet ones and nearly all that was planted is named.
    """
    each = -(-runs // len(PLANTED))
    situations = [plant(seed) for plant in PLANTED for seed in range(1, each + 1)][:runs]
    situations += [quiet(seed) for seed in range(1, runs + 1)]
    verdicts = list(in_order(judge, situations))
    invented = sum(one.named for one in verdicts if one.kind == "quiet")
    named = sum(one.named for one in verdicts if one.kind != "quiet")
    holds = not invented and named >= _NAMED * runs
    return Measured([asdict(one) for one in verdicts], (_table(verdicts), *_wrong(verdicts)), holds)


def judge(situation: Situation) -> SituationVerdict:
    """Run the situation, and see what is said of it."""
    with in_memory(situation.scenario()) as (plan, _):
        spent = account(plan.out)
    return SituationVerdict(situation.kind, situation.seed, _JUDGES[situation.kind](spent), _shortly(spent))


def _in_the_way(spent: TimeSpent) -> bool:
    """r1 waited for r2, which wants nowhere, at a door."""
    return spent.robots["r1"][Cause.DONE_IN_WAY.value] >= _LEAST_S and any(
        one.cause == Cause.DONE_IN_WAY.value and one.place == "door" and one.robots == ("r1", "r2")
        for one in spent.blockings
    )


def _wedged(spent: TimeSpent) -> bool:
    both = [spent.robots[robot][Cause.WEDGED.value] >= _LEAST_S for robot in ("r1", "r2")]
    return all(both) and spent.wedges.pairs == 1


def _found(name: str) -> Callable[[TimeSpent], bool]:
    return lambda spent: any(one.name == name and one.robots == ("r1",) for one in spent.findings)


def _invented(spent: TimeSpent) -> bool:
    quiet_causes = {cause.value for cause in _EXPECTED}
    strange = any(
        s for each in spent.robots.values() for cause, s in each.items() if cause not in quiet_causes
    )
    return strange or bool(spent.blockings) or bool(spent.findings) or spent.wedges.pairs > 0


_JUDGES: Final[Mapping[str, Callable[[TimeSpent], bool]]] = {
    "parked in a door": _in_the_way,
    "done in a door": _in_the_way,
    "wedged": _wedged,
    "carried": _found(CARRIED),
    "jammed": _found(JAMMED),
    "quiet": _invented,
}


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
