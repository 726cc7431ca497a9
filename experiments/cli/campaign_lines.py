"""What a campaign says of its runs: why some failed, and whether those repeated over Zenoh were the same."""

from collections.abc import Iterator
from statistics import median

from experiments.campaign.store import Store
from experiments.campaign.trial_record import CheckRecord


def causes(kept: Store) -> list[str]:
    """Why runs failed, a line for each cause."""
    found: dict[str, list[str]] = {}
    for record in kept.records():
        if record.failure is not None:
            found.setdefault(record.failure, []).append(f"{record.strategy} with seed {record.seed}")
    return [f"failed: {cause} ({len(who)} runs, first {who[0]})" for cause, who in found.items()]


def checked(kept: Store) -> Iterator[str]:
    """How many runs were repeated over Zenoh, and both speeds."""
    results = [record.result for record in kept.records() if record.result is not None]
    speed = f"{median(result.real_time_factor for result in results):.3g} x real time" if results else ""
    checks = list(kept.checks())
    if not checks:
        if results:
            yield f"in memory {speed} (median of {len(results)} runs); none was repeated over Zenoh"
        return
    same = sum(check.agrees for check in checks)
    speeds = [check.over_zenoh_speed for check in checks if check.over_zenoh_speed is not None]
    over = f", over Zenoh {median(speeds):.3g} x (of {len(speeds)})" if speeds else ""
    yield (
        f"{same} of {len(checks)} runs repeated as processes over Zenoh gave the same digest;"
        f" in memory {speed} (median of {len(results)} runs){over}, beside whatever else ran"
    )


def differing(kept: Store) -> list[str]:
    """A sentence for each run whose repetition was not the same."""
    return [_difference(check) for check in kept.checks() if not check.agrees]


def _difference(check: CheckRecord) -> str:
    run = f"{check.strategy} with seed {check.seed}"
    if check.failure is not None:
        return f"{run} came to its end in memory, but not over Zenoh: {check.failure}"
    return (
        f"{run} is another run over Zenoh than in memory: digest {check.over_zenoh} there,"
        f" {check.in_memory} here; nothing that this campaign shows can be trusted before it is known why"
    )
