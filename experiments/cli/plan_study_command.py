"""`acrc plan-study`: how many pairs of runs."""

from rich.console import Console

from deploy.usage import OptionError
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
