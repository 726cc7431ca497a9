"""What the runs of one strategy in one variant come to, in a line."""

from collections.abc import Iterable, Iterator, Sequence

from experiments.campaign.trial_record import TrialRecord
from observation.results.result import RunResult


def summaries(records: Iterable[TrialRecord]) -> Iterator[str]:
    """A line for each strategy in each variant, over the runs that came to an end."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for record in records:
        where = "".join(f", {key} = {value}" for key, value in record.variant.items())
        if record.result is not None:
            groups.setdefault((where, record.strategy), []).append(record.result)
    for (where, strategy), runs in groups.items():
        complete = sum(run.completion_s is not None for run in runs)
        yield (
            f"{strategy}{where}: all places in {complete} of {len(runs)} runs,"
            f" {sum(run.places_done for run in runs)} of {sum(run.places_total for run in runs)} places,"
            f" {sum(run.places_given_up for run in runs)} given up,"
            f" {sum(run.places_lost for run in runs)} lost,"
            f" {sum(run.contacts for run in runs)} contacts{_half(runs)}"
        )


def _half(runs: Sequence[RunResult]) -> str:
    """When half of the runs were settled; nothing where fewer ever were, which no median can tell."""
    settled = sorted(run.settled_s for run in runs if run.settled_s is not None)
    half = (len(runs) + 1) // 2
    return f", half of them settled by {settled[half - 1]:.1f} s" if len(settled) >= half else ""
