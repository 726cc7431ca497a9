"""All that a campaign shows: what failed, what was declared and comes of it, and estimates of all else."""

from collections.abc import Sequence
from dataclasses import dataclass

from actors.runtime.errors import AcrcError
from experiments.campaign import plan_taken
from experiments.campaign.store import Store
from experiments.comparison import sentences
from experiments.comparison.across_cells import AcrossCells, across_cells, told
from experiments.comparison.comparison import Comparison, PairedSample, compare, samples
from experiments.comparison.decision import LookedAt, Watch
from experiments.comparison.family import PairVerdict, verdicts
from experiments.statistics.paired_tests import LEAST_PAIRS


@dataclass(frozen=True)
class CampaignJudgement:
    """What is to be said of a campaign, and nothing that was not declared is tested."""

    failures: Sequence[str]
    """A sentence for each strategy that failed in some run."""
    declared: Sequence[str]
    """What was frozen before the first run, and what is not as frozen."""
    too_few: Sequence[str]
    family: Sequence[str]
    """How the declared comparisons are tested."""
    verdicts: Sequence[PairVerdict]
    """Of the declared comparisons, in their order."""
    looks: Sequence[LookedAt]
    """At the declared comparisons while the campaign went on; empty if nobody looked."""
    across: Sequence[AcrossCells]
    """The declared comparisons over all cells; empty with fewer than three."""
    samples: Sequence[PairedSample]
    """The declared ones first."""
    estimates: Sequence[Comparison]
    """Of every pair by every metric, the declared pairs first."""

    def sentences(self) -> list[str]:
        """All of it in words, but for the estimates."""
        return [
            *(f"{line}." for line in self.failures),
            *self.declared,
            *self.too_few,
            *self.family,
            *map(sentences.verdict, self.verdicts),
            *(line for one in self.across for line in told(one)),
        ]


def judge(kept: Store, only: str | None = None) -> CampaignJudgement:
    """Judge what of a campaign has ended; `only`: estimates of the metric of that name alone.

    A campaign that was looked at on its way is judged by its looks. Raises AcrcError for a damaged record.
    """
    study, records = kept.study, list(kept.records())
    found = samples(records, study)
    watch = Watch(kept) if kept.looks is not None else None
    looks = [] if watch is None else watch.looked_at()
    least = LEAST_PAIRS if watch is None else watch.rules.least
    decided = verdicts(found, study) if watch is None else [one.verdict for one in looks]
    decided = [one for one in decided if len(one.sample.pairs) >= least]
    estimates, too_few = compare(found, only, least), sentences.too_few(found, least)
    if only is not None and found and not estimates and not too_few:
        raise AcrcError(f"metric {only!r}: known of fewer than {least} pairs of runs; choose another")
    return CampaignJudgement(
        failures=sentences.failures(records, study),
        declared=plan_taken.told(kept),
        too_few=too_few,
        family=sentences.family(decided, study) if len(study.strategies) > 1 else [],
        verdicts=decided,
        looks=looks,
        across=across_cells(records, study),
        samples=found,
        estimates=estimates,
    )
