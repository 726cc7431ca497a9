"""A study and its trials: every strategy in every variant of a scenario, with the same seeds for all."""

import hashlib
import itertools
from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from actors.settings import Settings, Text

FIRST_SEED: Final = 1
FIRST_TUNING_SEED: Final = 1_000_001
"""Seeds below are for tests, from here on for tuning: nothing is judged by what it was tuned on."""
_NAME_BYTES: Final = 6
Variant = tuple[tuple[str, Any], ...]
"""Each factor's key, or name, and its value."""


class Factor(msgspec.Struct, frozen=True):
    """A key of the scenario and the values that it takes, or a name and its levels."""

    key: str
    values: tuple[Any, ...]
    levels: tuple[Variant, ...] = ()
    """What each value sets, as keys of the scenario, where `key` is a name of the study's own."""

    def settings(self, value: Any) -> Variant:
        """The keys of the scenario that a value sets."""
        return self.levels[self.values.index(value)] if self.levels else ((self.key, value),)


class Distribution(msgspec.Struct, frozen=True):
    """An uncertainty that is drawn for each seed, the same for every strategy; see `study.draws`."""

    kind: str
    parameters: tuple[tuple[str, Any], ...]
    """Each a number, or (from, to) between which it is drawn; for doors their points."""


class Trial(msgspec.Struct, frozen=True):
    """One run of a study."""

    strategy: str
    seed: int
    variant: Variant = ()
    """Here."""

    @property
    def name(self) -> str:
        """Names the trial's file; tells it from all others of a study."""
        told = msgspec.json.encode((self.strategy, self.seed, self.variant))
        return f"{self.seed:06d}-{hashlib.blake2b(told, digest_size=_NAME_BYTES).hexdigest()}"


class StudyTerms(Settings, frozen=True, kw_only=True):
    """What a study's file and the study have in common."""

    scenario: Annotated[Text, Meta(description="the path of a scenario, relative to the study's file")]
    """Absolute in a study."""
    strategies: Annotated[
        tuple[str, ...],
        Meta(min_length=1, description='a list of strategies, such as ["none", "chapter"]'),
    ]
    primary: Annotated[
        tuple[tuple[str, str], ...],
        Meta(description='a list of pairs of strategies, such as [["chapter", "none"]]'),
    ] = ()
    """The comparisons that the study is for, declared before it is carried out."""
    primary_metric: Annotated[Text, Meta(description='a metric, such as "places"')] = "lexicographic"
    """By which these are decided: one metric, or the chapter's order of places and time."""
    margin_places: Annotated[float, Meta(gt=0, le=1_000_000)] = 1.0
    """Strategies whose mean numbers of places differ by less are as good as each other."""
    margin_s: Annotated[float, Meta(gt=0, le=1_000_000)] = 10.0
    """The same of times, s."""
    failed_runs: Literal["worst", "left out"] = "worst"
    """What a run that failed counts as: one that did nothing, or none."""
    isolated: bool = False
    """Every run is made as isolated processes, for strategies of strangers."""


class Study(StudyTerms, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """What is run and why."""

    name: str
    seeds: int
    tuning: bool = False
    """True: for choosing settings; no test will have its seeds."""
    settings: tuple[tuple[str, Any], ...] = ()
    """Keys of the scenario that are other than in its file."""
    factors: tuple[Factor, ...] = ()
    distributions: tuple[Distribution, ...] = ()
    conditions: Literal["drawn", "as written"] = "as written"
    """Drawn: seeds draw whatever of `study.conditions` the study does not set."""
    random: tuple[Factor, ...] = ()
    """Factors whose levels come together in `cells`; values are those that came up."""
    cells: tuple[Variant, ...] = ()
    """Levels of the random factors, drawn when the study was read. Each comparison is over all of them."""

    @property
    def primary_pairs(self) -> tuple[tuple[str, str], ...]:
        """The comparisons declared beforehand; of two strategies there is but one."""
        if len(self.strategies) == 2 and not self.primary:
            return ((self.strategies[1], self.strategies[0]),)
        return self.primary

    @property
    def first_seed(self) -> int:
        """The others follow it."""
        return FIRST_TUNING_SEED if self.tuning else FIRST_SEED

    def fixed_variants(self) -> list[Variant]:
        """Every combination of the factors' values; one without any factor. Each is compared by itself."""
        choices = [[(factor.key, value) for value in factor.values] for factor in self.factors]
        return list(itertools.product(*choices))

    def variants(self) -> list[Variant]:
        """Each of these in every cell."""
        return [(*fixed, *cell) for fixed in self.fixed_variants() for cell in self.cells or ((),)]

    def fixed_part(self, variant: Variant) -> Variant:
        """What of a variant is no cell's."""
        drawn = {factor.key for factor in self.random}
        return tuple((key, value) for key, value in variant if key not in drawn)

    def settings_of(self, variant: Variant) -> Variant:
        """All that the study sets in a variant, as keys of the scenario."""
        known = {factor.key: factor for factor in (*self.factors, *self.random)}
        own = (known[key].settings(value) if key in known else ((key, value),) for key, value in variant)
        return (*self.settings, *itertools.chain.from_iterable(own))

    def trials(self) -> Iterator[Trial]:
        """All of them, seed by seed, so that whatever is there at any moment can be compared."""
        for seed in range(self.first_seed, self.first_seed + self.seeds):
            yield from self.trials_of(seed)

    def trials_of(self, seed: int) -> Iterator[Trial]:
        """Those with one seed: every strategy in every variant."""
        for variant in self.variants():
            for strategy in self.strategies:
                yield Trial(strategy, seed, variant)


def differences(one: Study, other: Study) -> dict[str, tuple[str, str]]:
    """The fields by which two studies differ, each with both values as JSON, where a tuple is a list."""
    found = {}
    for field in Study.__struct_fields__:
        mine, theirs = (
            msgspec.json.encode(getattr(study, field), order="sorted").decode() for study in (one, other)
        )
        if mine != theirs:
            found[field] = mine, theirs
    return found
