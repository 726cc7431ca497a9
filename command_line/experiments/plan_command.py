"""`acrc study plan`: how many pairs of runs."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from actors.console import print_table, screen
from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError
from command_line.options import answer
from experiments.campaign import store
from experiments.comparison import metrics
from experiments.comparison.comparison import PairedSample, samples
from experiments.comparison.family import primary, tests_of
from experiments.comparison.pilot import Promise, ceilings, promises
from experiments.comparison.sentences import failures
from experiments.statistics.sample_size import Effect, pairs_needed
from experiments.study.study import Study


def run(a12: float, power: float, correlation: float, comparisons: int, *, json: bool) -> None:
    """Print the number of pairs that an effect needs; a comparison has two tests, of places and of times."""
    tests = 2 * comparisons
    try:
        pairs = pairs_needed(Effect(a12, correlation, power, tests))
    except ValueError as error:
        raise OptionError(f"--a12: {error}") from None
    said = (
        f"{pairs} pairs of runs show an effect of A12 = {a12:g} with probability {power:g} at 5 % shared by "
        f"{tests} tests, if two runs with the same seed correlate by {correlation:g}."
    )
    told = {"pairs": pairs, "a12": a12, "power": power, "correlation": correlation, "tests": tests}
    answer([said], told, json=json)


def run_pilot(folder: Path, metric: str | None, power: float, comparisons: int, *, json: bool) -> None:
    """Print how often campaigns of a size would tell the declared strategies apart, and what is too easy."""
    if comparisons > 1:
        raise OptionError("--comparisons: cannot be combined with --pilot, whose study declares them")
    kept = store.load(folder)
    if metric is not None and not metrics.is_metric(metric):
        raise wrong_value("--metric", metric, metrics.CHOICE)
    study = msgspec.structs.replace(kept.study, primary_metric=metric or kept.study.primary_metric)
    records = list(kept.records())
    found = primary(samples(records, study), study)
    if not found or not all(sample.pairs for sample in found):
        raise AcrcError(f"{folder}: has no pair of a declared comparison; must hold at least one of each")
    made = list(promises(found, study, power))
    if json:
        names = [f"{sample.one} and {sample.other}{sample.where}" for sample in found]
        told = {"comparisons": names, "tests": tests_of(study), "power": power, "promises": made}
        answer([], told, json=True)
        return
    console = screen()
    for line in failures(records, study):
        console.print(line)
    _print(console, found, made, study, power)
    for line in ceilings(records):
        console.print(line)
    if not kept.study.tuning:
        console.print(
            "These are seeds of tests, which have been looked at now; a pilot with --tuning has its own."
        )


def _print(
    console: Console, found: Sequence[PairedSample], made: Sequence[Promise], study: Study, power: float
) -> None:
    names = [f"{sample.one} and {sample.other}{sample.where}" for sample in found]
    known = min(len(sample.pairs) for sample in found)
    title = f"Share of campaigns that tell them apart, by {tests_of(study)} tests"
    table = Table("pairs", *names, title=title)
    for one in made:
        shares = zip(one.shares, one.cautious, strict=True)
        table.add_row(str(one.pairs), *(f"{share:.2f} ({cautious:.2f})" for share, cautious in shares))
    print_table(console, table)
    console.print(f"In brackets: if the {known} seeds of the pilot are themselves drawn.")
    last = made[-1]
    if min(last.shares) >= power:
        console.print(f"{last.pairs} pairs tell each of them apart with probability {power:g}.")
    else:
        open_ones = [name for name, share in zip(names, last.shares, strict=True) if share < power]
        console.print(
            f"{last.pairs} pairs do not reach probability {power:g} for {', '.join(open_ones)}.", markup=False
        )
