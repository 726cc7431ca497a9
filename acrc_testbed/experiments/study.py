"""A study, its file and its trials: every strategy in every variant of a scenario, with the same seeds."""

import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from actors import settings
from actors.installation.repository import SHIPPED
from actors.installation.usage import command_line
from actors.randomness import generator
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.settings import Place, RuleError, Settings, Text
from deploy.scenario.scenario_file import check_exists, is_scenario

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


PARAMETERS: Final[Mapping[str, tuple[str, ...]]] = {
    "kills": ("count", "at"),
    "jams": ("count", "at", "radius", "duration"),
    "dropout": ("share",),
    "odometry": ("drift",),
    "doors": ("count", "points", "radius"),
    "closures": ("count", "at", "duration"),
    "tasks": ("count", "at"),
}
"""By kind: what the study says of it. Kills: `count` robots end, each at an instant of its own. Jams: jammers
somewhere on the floor. Dropout: this share of all rays gives no echo. Odometry: its errors are so many times
as large; exact odometry becomes that of a Kobuki. Doors: at `count` of the `points` something round stands
from the beginning on. Closures: `count` doors of the map close, each at an instant, and open again after a
while. Tasks: `count` places, drawn as places are, that a robot each is given at an instant."""
MOST_SEEDS: Final = 100_000
MOST_SAMPLES: Final = 1000
_LARGEST: Final = 1 << 20
_CANDIDATES: Final = 64
"""Latin hypercubes of which the most even one is taken."""
_DIGITS: Final = 9
"""Of a discrepancy: what differs less is equal, whatever the processor makes of the last bits."""
_SPAN_DIGITS: Final = 4
"""Significant ones of a drawn number that is not whole."""


class RandomFactor(NamedTuple):
    """A factor of which a study draws levels: from a list, or from all numbers between two."""

    key: str
    among: tuple[Any, ...] = ()
    """Empty: between."""
    between: tuple[float, float] = (0.0, 0.0)
    """Whole numbers, both included, if both are whole."""

    @property
    def levels(self) -> float:
        """How many there are; infinite of numbers that are not whole."""
        if self.among:
            return len(self.among)
        return self.between[1] - self.between[0] + 1 if _whole(self.between) else math.inf

    def level(self, share: float) -> Any:
        """The level at this share, from 0 to below 1, of all there are."""
        low, high = self.between
        if self.among:
            return self.among[int(share * len(self.among))]
        if _whole(self.between):
            return int(low) + int(share * (int(high) - int(low) + 1))
        return float(f"{low + share * (high - low):.{_SPAN_DIGITS}g}")


def draw_cells(factors: Sequence[RandomFactor], samples: int, seed: int) -> tuple[Variant, ...]:
    """So many different cells: a level of each factor. The same seed gives the same.

    A Latin hypercube (McKay, Beckman and Conover 1979): each factor's levels come up equally often, to one.
    Of several, the one with most different cells, and of these with the lowest centred discrepancy.
    AcrcError if the factors have fewer combinations, or no cube has enough different cells.
    """
    from scipy.stats import qmc

    combinations = math.prod(factor.levels for factor in factors)
    if samples > combinations:
        raise AcrcError(
            f"samples is {samples}, but the random factors have {combinations:g} combinations; must be at "
            "most that many, and with all of them values = [...] says the same"
        )
    sampler = qmc.LatinHypercube(len(factors), rng=generator(seed, "study", "cells"))
    best: tuple[int, float] | None = None
    cells: tuple[Variant, ...] = ()
    for _ in range(_CANDIDATES):
        points = sampler.random(samples)
        drawn = [_cell(factors, row) for row in points]
        found = tuple({repr(cell): cell for cell in drawn}.values())
        rank = (-len(found), round(float(qmc.discrepancy(points)), _DIGITS))
        if best is None or rank < best:
            best, cells = rank, found
    if len(cells) < samples:
        raise AcrcError(
            f"samples is {samples}, but only {len(cells)} different cells come of random factors with "
            f"{combinations:g} combinations; must be at most {len(cells)}, or the factors have more levels"
        )
    return cells


def _cell(factors: Sequence[RandomFactor], shares: NDArray[np.float64]) -> Variant:
    return tuple((one.key, one.level(float(share))) for one, share in zip(factors, shares, strict=True))


def _whole(between: tuple[float, float]) -> bool:
    return all(isinstance(one, int) for one in between)


_NOT_RANDOM: Final = "run.duration"
"""Runs of one comparison are watched equally long."""


_Amount = Annotated[float, Meta(ge=0, le=1_000_000)]
_Range = Annotated[
    _Amount | tuple[_Amount, _Amount],
    Meta(description="a number from 0 on, or a range [from, to] of them"),
]
_Values = Annotated[tuple[Any, ...], Meta(min_length=1, description="a list of at least one value")]
_Seeds = Annotated[int, Meta(ge=1, le=MOST_SEEDS)]


class VaryTable(Settings, frozen=True):
    """[[vary]]: a factor and its values one after the other or drawn, or what is drawn for each seed."""

    key: Annotated[Text, Meta(description='a key of the scenario, such as "robots.count"')] | None = None
    factor: Annotated[Text, Meta(description='a name of your own, such as "floor"')] | None = None
    """In place of a key: each value is a table with a name and several keys of the scenario."""
    values: _Values | None = None
    """Each with each of the other factors."""
    among: _Values | None = None
    """The factor is random: levels are drawn from these."""
    between: Annotated[tuple[int | float, int | float], Meta(description="two numbers [from, to]")] | None = (
        None
    )
    """The factor is random: levels are drawn between these, whole ones if both are."""
    distribution: Literal["kills", "jams", "dropout", "odometry", "doors", "closures", "tasks"] | None = None
    """What is drawn; its parameters are those of `study.draws.PARAMETERS`."""
    count: _Range | None = None
    """How many."""
    at: _Range | None = None
    """When, s."""
    radius: _Range | None = None
    """Of a jammer's reach, or of what stands in a door, m."""
    duration: _Range | None = None
    """s."""
    share: _Range | None = None
    drift: _Range | None = None
    points: (
        Annotated[tuple[Place, ...], Meta(min_length=1, description="a list of points [x, y] in m")] | None
    ) = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = {name for name in self.__struct_fields__ if getattr(self, name) is not None}
        for name in given:
            span = getattr(self, name)
            if name in {"between", *_RANGES} and isinstance(span, tuple) and span[0] > span[1]:
                raise self.wrong(name)
        if self.distribution is None and given not in _FACTORS:
            raise RuleError(
                "have a key and its values, or a distribution and its parameters; among = [...] or "
                "between = [from, to] in place of values draws levels, and factor = NAME in place of key "
                "has tables of several keys as values"
            )
        if self.distribution and given != {"distribution", *PARAMETERS[self.distribution]}:
            needs = ", ".join(PARAMETERS[self.distribution])
            raise RuleError(f"have {needs} beside the distribution {self.distribution}, and nothing else")

    @property
    def is_random(self) -> bool:
        """True if levels of a factor are drawn."""
        return self.among is not None or self.between is not None


_RANGES: Final = ("count", "at", "radius", "duration", "share", "drift")
_FACTORS: Final = (
    {"key", "values"}, {"key", "among"}, {"key", "between"}, {"factor", "values"}, {"factor", "among"},
)  # fmt: skip


class _StudyFile(StudyTerms, frozen=True, kw_only=True):
    """The file."""

    seeds: _Seeds = 10
    """So many seeds, from 1 on, for each strategy and variant."""
    tuning_seeds: _Seeds = 10
    """So many for `--tuning`: other ones, which no test ever has."""
    set: Annotated[dict[str, Any], Meta(description="a table of keys of the scenario")] = msgspec.field(
        default_factory=dict
    )
    """Keys of the scenario that are other than in its file, such as "run.duration" = 300."""
    conditions: Literal["drawn", "as written"] = "drawn"
    """Whether seeds draw starts, places, odometry's errors and shadowing where nothing here sets them."""
    vary: tuple[VaryTable, ...] = ()
    samples: Annotated[int, Meta(ge=1, le=MOST_SAMPLES)] | None = None
    """So many cells are drawn from the random factors."""


def load_study(path: Path, *, tuning: bool = False) -> Study:
    """The study in a file, also in one that a campaign has written (`study.json`). Raises AcrcError."""
    if path.suffix == ".json":
        return _written(path)
    check_exists(path, SHIPPED / "studies")
    if is_scenario(path):
        compared = command_line("campaign", path)
        raise AcrcError(f"{path}: is a scenario, must be a study; to compare strategies in it: {compared}")
    table = settings.load(path, _StudyFile, "study", _LARGEST)
    strategies = tuple(dict.fromkeys(table.strategies))
    for pair in table.primary:
        for name in pair:
            if name not in strategies:
                raise AcrcError(
                    f"{path}: primary compares {name!r}, which is none of the study's strategies: "
                    f"{', '.join(strategies)}"
                )
    try:
        made = factors_of(table.vary, table.samples, FIRST_TUNING_SEED if tuning else FIRST_SEED)
    except AcrcError as error:
        raise AcrcError(f"{path}: {error}") from None
    shared = {name: getattr(table, name) for name in StudyTerms.__struct_fields__} | {
        "scenario": str((path.parent / table.scenario).resolve()),
        "strategies": strategies,
    }
    return Study(
        name=path.stem,
        seeds=table.tuning_seeds if tuning else table.seeds,
        tuning=tuning,
        settings=tuple(table.set.items()),
        factors=made.fixed,
        distributions=made.distributions,
        random=made.random,
        cells=made.cells,
        conditions=table.conditions,
        **shared,
    )


def _written(path: Path) -> Study:
    """A path in it is relative to the file, as in any study's."""
    study = typed_json.read(path, Study, "study of a campaign")
    return msgspec.structs.replace(study, scenario=str((path.parent / study.scenario).resolve()))


class VariedParts(NamedTuple):
    """What the tables of a study come to."""

    fixed: tuple[Factor, ...]
    random: tuple[Factor, ...]
    cells: tuple[Variant, ...]
    distributions: tuple[Distribution, ...]


def factors_of(tables: Sequence[VaryTable], samples: int | None, seed: int) -> VariedParts:
    """The factors of a study, and its cells drawn with this seed. AcrcError says what is wrong with them."""
    fixed: list[Factor] = []
    drawn: list[Factor] = []
    spans: list[RandomFactor] = []
    taken: set[str] = set()
    for place, table in enumerate(tables):
        if table.distribution is not None:
            continue
        made = _factor(table, f"vary[{place}]")
        keys = {made.key, *(key for level in made.levels for key, _ in level)}
        if keys & taken:
            raise AcrcError(f"vary[{place}] sets {min(keys & taken)} once more; must leave it to one factor")
        taken |= keys
        if not table.is_random:
            fixed.append(made)
            continue
        if _NOT_RANDOM in keys:
            raise AcrcError(f"vary[{place}] draws {_NOT_RANDOM}; must be fixed, so that runs compare")
        drawn.append(made)
        spans.append(RandomFactor(made.key, made.values, table.between or (0, 0)))
    if bool(spans) != (samples is not None):
        has = (
            f"samples is {samples}, but no factor has" if samples else "samples is missing, but a factor has"
        )
        raise AcrcError(f"{has} among or between; must have both or neither")
    cells = draw_cells(spans, samples, seed) if samples is not None else ()
    distributions = tuple(_distribution(table) for table in tables if table.distribution is not None)
    return VariedParts(tuple(fixed), tuple(_seen(one, cells) for one in drawn), cells, distributions)


def _factor(table: VaryTable, where: str) -> Factor:
    values = table.values or table.among or ()
    if table.factor is None:
        assert table.key is not None
        return Factor(table.key, values)
    for place, value in enumerate(values):
        if not (isinstance(value, Mapping) and isinstance(value.get("name"), str) and len(value) > 1):
            raise AcrcError(
                f"{where}.{'values' if table.values else 'among'}[{place}] is {value!r}; must be a table "
                'with a name and keys of the scenario, such as {name = "maze", map = "../maps/maze.yaml"}'
            )
    names = tuple(value["name"] for value in values)
    if len(set(names)) < len(names):
        raise AcrcError(f"{where} has two levels of one name ({', '.join(names)}); each must have its own")
    levels = tuple(tuple(_dotted(value, ("name",))) for value in values)
    return Factor(table.factor, names, levels)


def _dotted(table: Mapping[str, Any], without: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
    """Keys of the scenario, also where the file has tables in tables."""
    for key, value in table.items():
        if key in without:
            continue
        if isinstance(value, Mapping):
            yield from ((f"{key}.{part}", inner) for part, inner in _dotted(value))
        else:
            yield key, value


def _seen(factor: Factor, cells: Sequence[Variant]) -> Factor:
    """A random factor with the levels that came up, in the order of the file or of size."""
    came = {repr(value): value for cell in cells for key, value in cell if key == factor.key}
    if not factor.values:
        return Factor(factor.key, tuple(sorted(came.values())))
    places = [place for place, value in enumerate(factor.values) if repr(value) in came]
    levels = tuple(factor.levels[place] for place in places) if factor.levels else ()
    return Factor(factor.key, tuple(factor.values[place] for place in places), levels)


def _distribution(table: VaryTable) -> Distribution:
    assert table.distribution is not None
    names = PARAMETERS[table.distribution]
    given = [(name, getattr(table, name)) for name in names]
    spans = ((name, (one, one) if isinstance(one, float) else one) for name, one in given)
    return Distribution(table.distribution, tuple(spans))
