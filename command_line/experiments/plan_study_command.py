"""`acrc plan-study`: how many pairs of runs."""

from pathlib import Path

from rich.console import Console

from actors.installation.usage import OptionError, wrong_value
from experiments.campaign import store
from experiments.comparison import metrics
from experiments.comparison.comparison import samples
from experiments.comparison.pilot import ceilings, estimate, told
from experiments.statistics.sample_size import Effect, pairs_needed


def run(a12: float, power: float, correlation: float, comparisons: int) -> None:
    """Print the number of pairs that an effect needs."""
    effect = Effect(a12, correlation, power, comparisons=comparisons)
    try:
        pairs = pairs_needed(effect)
    except ValueError as error:
        raise OptionError(f"--a12: {error}") from None
    shared = f" with {comparisons} comparisons sharing it" if comparisons > 1 else ""
    Console(soft_wrap=True, highlight=False).print(
        f"{pairs} pairs of runs show an effect of A12 = {a12:g} with probability {power:g} at 5 %{shared}, "
        f"if two runs with the same seed correlate by {correlation:g}."
    )


def run_pilot(folder: Path, metric: str | None, power: float, comparisons: int) -> None:
    """Print how many pairs the effects of a campaign need, and where its runs are too easy to tell."""
    kept = store.load(folder)
    metric = metric or kept.study.primary_metric
    if metric not in metrics.NAMES:
        raise wrong_value("--metric", metric, f"one of {', '.join(metrics.NAMES)}")
    console = Console(soft_wrap=True, highlight=False)
    found = samples(kept.records(), kept.study.primary_pairs)
    for sample in found:
        console.print(told(estimate(sample, metric, power, comparisons)), markup=False)
    for line in ceilings(kept.records()):
        console.print(line, markup=False)
    if not kept.study.tuning:
        console.print(
            "These are seeds of tests, which have been looked at now; a pilot with --tuning has its own."
        )
