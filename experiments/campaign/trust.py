"""What can be trusted of a campaign: how its runs were made, and whether repetitions were the same."""

from collections.abc import Iterator, Sequence
from statistics import median
from typing import Final

from experiments.campaign.store import Store
from experiments.campaign.trial_record import CheckRecord
from observation.results.result import RunResult

IN_MEMORY: Final = (
    "Made in memory: there a strategy can reach the world, the referee and its own result, so this is for "
    "strategies that you trust; `acrc campaign --isolate` makes every run as isolated processes."
)
ISOLATED: Final = (
    "Every run was made as isolated processes: no strategy could reach the world, the referee or its result."
)
_MOST_TOLD: Final = 3


def protection(kept: Store) -> list[str]:
    """What is protected in these runs and what is not, in sentences that come before all others."""
    results = [record.result for record in kept.records() if record.result is not None]
    other = [f"{line}." for line in other_software(kept)]
    if kept.study.isolated:
        open_ = sum(result.isolation != "full" for result in results)
        isolated = (
            f"{open_} of {len(results)} runs were NOT isolated, as the study wants." if open_ else ISOLATED
        )
        return [isolated, *other]
    return [IN_MEMORY, *_repeated(kept, results), *other]


def other_software(kept: Store) -> list[str]:
    """Which runs were made with software that was changed or committed after the campaign had begun."""
    made = [record.result.origin.commit for record in kept.records() if record.result is not None]
    others = [commit for commit in made if commit != kept.commit]
    if not others:
        return []
    return [
        f"{len(others)} of {len(made)} runs were made with other software than {kept.commit}, with which the "
        f"campaign began: {', '.join(dict.fromkeys(others))}"
    ]


def _repeated(kept: Store, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield how many runs were repeated as processes, how many of them isolated, and both speeds."""
    if not results:
        return
    checks = list(kept.checks())
    speed = f"{median(result.real_time_factor for result in results):.3g} x real time"
    if not checks:
        yield f"None of {len(results)} runs was repeated as processes; in memory {speed} (median)."
        return
    isolated = sum(check.isolation == "full" for check in checks)
    speeds = [check.over_zenoh_speed for check in checks if check.over_zenoh_speed is not None]
    over = f", as processes {median(speeds):.3g} x" if speeds else ""
    same = sum(check.agrees for check in checks)
    yield (
        f"{len(checks)} of {len(results)} runs were repeated as processes ({isolated} isolated): "
        f"{same} gave the same result; in memory {speed} (median){over}."
    )


def differing(kept: Store) -> list[str]:
    """Return a sentence for each run whose repetition had another result."""
    return [_difference(check) for check in kept.checks() if not check.agrees]


def _difference(check: CheckRecord) -> str:
    run = f"{check.strategy} with seed {check.seed}"
    if check.failure is not None:
        return f"{run} came to its end in memory, but not over Zenoh: {check.failure}"
    what = f"digest {check.in_memory} in memory, {check.over_zenoh} there"
    if check.in_memory == check.over_zenoh:
        what = "; ".join(check.differs[:_MOST_TOLD])
        what += f"; and {len(check.differs) - _MOST_TOLD} more" if len(check.differs) > _MOST_TOLD else ""
    return (
        f"{run} is another run over Zenoh than in memory: {what}; nothing that this campaign shows can be "
        "trusted before it is known why"
    )
