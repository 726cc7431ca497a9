"""Study, its TOML file and its trials: all strategies in all variants of a scenario, with equal seeds."""

import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
from msgspec import Meta

from acrc_testbed.experiments.metrics import (
    LEXICOGRAPHIC,
    MetricTable,
    by_rank,
    check_names,
    choice,
    find_metric,
    task_metrics,
)
from actors import settings
from actors.installation.repository import SHIPPED
from actors.installation.usage import command_line
from actors.randomness import generator
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.settings import Place, RuleError, Settings, Text, read_text, toml_tables
from actors.task.loading import DEFAULT, task_setup
from actors.task.task import Metric, TaskDeclaration
from deploy.scenario.scenario_file import check_exists, is_scenario

FIRST_SEED: Final = 1
FIRST_TUNING_SEED: Final = 1_000_001
"""Seeds from here on are for tuning and are never used by tests."""
_NAME_BYTES: Final = 6
Variant = tuple[tuple[str, Any], ...]
"""Key or name of each factor, and its value."""


def variant_text(variant: Iterable[tuple[str, Any]]) -> str:
    """Return keys and values as text."""
    return ", ".join(f"{key} = {value}" for key, value in variant)


class Factor(msgspec.Struct, frozen=True):
    """A key of the scenario and its values, or a name and its levels."""

    key: str
    values: tuple[Any, ...]
    levels: tuple[Variant, ...] = ()
    """Keys of the scenario set by each value, if `key` is a name defined by the study."""

    def settings(self, value: Any) -> Variant:
        """Return the keys of the scenario set by a value."""
        return self.levels[self.values.index(value)] if self.levels else ((self.key, value),)


class Distribution(msgspec.Struct, frozen=True):
    """A random condition drawn for each seed, equal for all strategies; see `trial_settings`."""

    kind: str
    parameters: Variant
    """Each a number or a range (from, to); for doors their points."""


class Trial(msgspec.Struct, frozen=True):
    """One run of a study."""

    strategy: str
    seed: int
    variant: Variant = ()
    """Values of the factors."""

    @property
    def name(self) -> str:
        """Unique name of the trial in its study, used for files."""
        key = msgspec.json.encode((self.strategy, self.seed, self.variant))
        return f"{self.seed:06d}-{hashlib.blake2b(key, digest_size=_NAME_BYTES).hexdigest()}"


class CommonStudyFields(Settings, frozen=True, kw_only=True):
    """Fields common to a study's file and the study."""

    scenario: Annotated[Text, Meta(description="the path of a scenario, relative to the study's file")]
    """Absolute in `Study`."""
    strategies: Annotated[
        tuple[str, ...],
        Meta(min_length=1, description='a list of strategies, such as ["none", "chapter"]'),
    ]
    primary: Annotated[
        tuple[tuple[str, str], ...],
        Meta(description='a list of pairs of strategies, such as [["chapter", "none"]]'),
    ] = ()
    """Primary comparisons, declared before the first run."""
    primary_metric: Annotated[Text, Meta(description='a metric, such as "contacts"')] = LEXICOGRAPHIC
    """Metric of the primary comparisons; lexicographic: the task's order of metrics."""
    margins: Annotated[
        dict[str, Annotated[float, Meta(gt=0, le=1_000_000)]],
        Meta(description="a table of positive numbers by metric"),
    ] = msgspec.field(default_factory=dict)
    """Equivalence margins of means by metric, in its unit; absent: as declared by the task."""
    failed_runs: Literal["worst", "left out"] = "worst"
    """Treatment of failed runs: count with the worst values of metrics, or leave out."""
    metric: tuple[MetricTable, ...] = ()
    """The study's own metrics."""
    isolated: bool = False
    """Run robots as isolated processes, for untrusted strategies."""


class Study(CommonStudyFields, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """Strategies, conditions and seeds to compare."""

    name: str
    task: TaskDeclaration
    """Task of all runs, with its metrics."""
    seeds: int
    tuning: bool = False
    """True: for choosing settings, with seeds that no test uses."""
    settings: Variant = ()
    """Overridden keys of the scenario."""
    factors: tuple[Factor, ...] = ()
    distributions: tuple[Distribution, ...] = ()
    conditions: Literal["drawn", "as written"] = "as written"
    """Drawn: each seed draws the conditions that the study does not set."""
    random: tuple[Factor, ...] = ()
    """Random factors, with the levels drawn for `cells`."""
    cells: tuple[Variant, ...] = ()
    """Drawn combinations of the random factors' levels. Each comparison covers all of them."""
    modules: str = ""
    """Folder of the study's file, which may contain the functions of its metrics; empty without."""

    def metrics(self) -> dict[str, Metric]:
        """Return the metrics by name, in order of display, with the study's margins."""
        found = task_metrics(self.task) | {table.name: table.metric() for table in self.metric}
        return {name: one._replace(margin=self.margins.get(name, one.margin)) for name, one in found.items()}

    def step_metrics(self) -> tuple[Metric, ...]:
        """Return the metrics of primary comparisons, in order. Raises AcrcError for an unknown metric."""
        metrics = self.metrics()
        if (found := find_metric(self.primary_metric, metrics)) is None:
            raise AcrcError(f"primary_metric is {self.primary_metric!r}; must be {choice(metrics)}")
        return by_rank(metrics.values()) if found.name == LEXICOGRAPHIC else (found,)

    @property
    def primary_pairs(self) -> tuple[tuple[str, str], ...]:
        """Declared comparisons; two strategies have one by default, second versus first."""
        if len(self.strategies) == 2 and not self.primary:
            return ((self.strategies[1], self.strategies[0]),)
        return self.primary

    @property
    def first_seed(self) -> int:
        """First of the consecutive seeds."""
        return FIRST_TUNING_SEED if self.tuning else FIRST_SEED

    def fixed_variants(self) -> list[Variant]:
        """Return every combination of the fixed factors' values. Each is compared separately."""
        choices = [[(factor.key, value) for value in factor.values] for factor in self.factors]
        return list(itertools.product(*choices))

    def variants(self) -> list[Variant]:
        """Return every combination of fixed variant and random cell."""
        return [(*fixed, *cell) for fixed in self.fixed_variants() for cell in self.cells or ((),)]

    def fixed_part(self, variant: Variant) -> Variant:
        """Return a variant without random factors."""
        drawn = {factor.key for factor in self.random}
        return tuple((key, value) for key, value in variant if key not in drawn)

    def settings_of(self, variant: Variant) -> Variant:
        """Return all keys of the scenario that the study sets in a variant."""
        known = {factor.key: factor for factor in (*self.factors, *self.random)}
        own = (known[key].settings(value) if key in known else ((key, value),) for key, value in variant)
        return (*self.settings, *itertools.chain.from_iterable(own))

    def trials(self) -> Iterator[Trial]:
        """Yield all trials seed by seed, so that an incomplete campaign can be compared."""
        for seed in range(self.first_seed, self.first_seed + self.seeds):
            yield from self.trials_of(seed)

    def trials_of(self, seed: int) -> Iterator[Trial]:
        """Yield the trials of one seed: every strategy in every variant."""
        for variant in self.variants():
            for strategy in self.strategies:
                yield Trial(strategy, seed, variant)


def differences(one: Study, other: Study) -> dict[str, tuple[str, str]]:
    """Return the fields in which two studies differ, with both values as JSON."""
    found = {}
    for field in Study.__struct_fields__:
        mine, theirs = (
            msgspec.json.encode(getattr(study, field), order="sorted").decode() for study in (one, other)
        )
        if mine != theirs:
            found[field] = mine, theirs
    return found


PARAMETERS: Final = {
    "kills": ("count", "at"),
    "jams": ("count", "at", "radius", "duration"),
    "dropout": ("share",),
    "odometry": ("drift",),
    "doors": ("count", "points", "radius"),
    "closures": ("count", "at", "duration"),
    "tasks": ("count", "at"),
}
"""Parameters of each kind of distribution. Kills: `count` robots end, at random instants. Jams: `count`
jammers at random points. Dropout: share of scan rays without echo. Odometry: factor of its errors; exact
odometry becomes a Kobuki's. Doors: round obstacles at `count` of the `points` from the start. Closures:
`count` doors close at random instants and reopen. Tasks: `count` items at random points, each given to a
robot."""
MAX_SEEDS: Final = 100_000
MAX_SAMPLES: Final = 1000
_MAX_BYTES: Final = 1 << 20
_CANDIDATES: Final = 64
"""Latin hypercubes to draw; the one of least discrepancy is used."""
_DISCREPANCY_DIGITS: Final = 9
"""Decimals to which discrepancies are compared, so that processors agree."""
_LEVEL_DIGITS: Final = 4
"""Significant digits of a drawn non-integer level."""


class RandomFactor(NamedTuple):
    """A factor with random levels, from a list or a range."""

    key: str
    among: tuple[Any, ...] = ()
    """List of levels; empty: use `between`."""
    between: tuple[float, float] = (0.0, 0.0)
    """Range of levels; integers, both ends included, if both ends are integers."""

    @property
    def levels(self) -> float:
        """Number of levels; infinite for a range of floats."""
        if self.among:
            return len(self.among)
        return self.between[1] - self.between[0] + 1 if _is_integer_range(self.between) else math.inf

    def level(self, share: float) -> Any:
        """Return the level at this quantile, in [0, 1)."""
        low, high = self.between
        if self.among:
            return self.among[int(share * len(self.among))]
        if _is_integer_range(self.between):
            return int(low) + int(share * (int(high) - int(low) + 1))
        return float(f"{low + share * (high - low):.{_LEVEL_DIGITS}g}")


def draw_cells(factors: Sequence[RandomFactor], samples: int, seed: int) -> tuple[Variant, ...]:
    """Draw `samples` different cells, each with a level of every factor; deterministic for a seed.

    Latin hypercube (McKay, Beckman and Conover 1979): frequencies of a factor's levels differ by at most one.
    Among several hypercubes, most different cells, then least centred discrepancy decide. Raises
    AcrcError if the factors have fewer combinations, or no hypercube has enough different cells.
    """
    from scipy.stats import qmc

    combinations = math.prod(factor.levels for factor in factors)
    if samples > combinations:
        raise AcrcError(
            f"samples: {samples} exceeds the {combinations:g} combinations of the random factors; use fewer, "
            "or fixed factors (values = [...]) for all combinations"
        )
    sampler = qmc.LatinHypercube(len(factors), rng=generator(seed, "study", "cells"))
    ranked = []
    for _ in range(_CANDIDATES):
        points = sampler.random(samples)
        drawn = [
            tuple((one.key, one.level(share)) for one, share in zip(factors, row, strict=True))
            for row in points.tolist()
        ]
        found = tuple({repr(cell): cell for cell in drawn}.values())
        rank = (-len(found), round(float(qmc.discrepancy(points)), _DISCREPANCY_DIGITS))
        ranked.append((rank, found))
    _, cells = min(ranked, key=itemgetter(0))
    if len(cells) < samples:
        raise AcrcError(
            f"samples: only {len(cells)} of {samples} cells differ, as the random factors have "
            f"{combinations:g} combinations; use at most {len(cells)} samples or more levels"
        )
    return cells


def _is_integer_range(between: tuple[float, float]) -> bool:
    return all(isinstance(one, int) for one in between)


_NEVER_RANDOM: Final = "run.duration"
"""All runs of a comparison must have equal duration."""


_Amount = Annotated[float, Meta(ge=0, le=1_000_000)]
_Range = Annotated[
    _Amount | tuple[_Amount, _Amount],
    Meta(description="a number of at least 0, or a range [from, to] of such numbers"),
]
_Values = Annotated[tuple[Any, ...], Meta(min_length=1, description="a list of at least one value")]
_Seeds = Annotated[int, Meta(ge=1, le=MAX_SEEDS)]


class VaryTable(Settings, frozen=True):
    """[[vary]]: a factor with its values or random levels, or a distribution drawn for each seed."""

    key: Annotated[Text, Meta(description='a key of the scenario, such as "robots.count"')] | None = None
    factor: Annotated[Text, Meta(description='a name of your own, such as "floor"')] | None = None
    """Instead of `key`: each value is a table with a name and several keys of the scenario."""
    values: _Values | None = None
    """Levels of a fixed factor, combined with all other factors."""
    among: _Values | None = None
    """Levels from which those of a random factor are drawn."""
    between: Annotated[tuple[int | float, int | float], Meta(description="two numbers [from, to]")] | None = (
        None
    )
    """Range of a random factor's levels; integers if both ends are integers."""
    distribution: Literal["kills", "jams", "dropout", "odometry", "doors", "closures", "tasks"] | None = None
    """Kind of distribution; for its parameters see `PARAMETERS`."""
    count: _Range | None = None
    """Number of events."""
    at: _Range | None = None
    """Instant, s."""
    radius: _Range | None = None
    """Radius of a jammer's reach, or of an obstacle in a door, m."""
    duration: _Range | None = None
    """Length, s."""
    share: _Range | None = None
    drift: _Range | None = None
    points: (
        Annotated[tuple[Place, ...], Meta(min_length=1, description="a list of points [x, y] in m")] | None
    ) = None

    def __post_init__(self) -> None:
        super().__post_init__()
        present = {name for name in self.__struct_fields__ if getattr(self, name) is not None}
        for name in present:
            span = getattr(self, name)
            if name in {"between", *_RANGES} and isinstance(span, tuple) and span[0] > span[1]:
                raise self.wrong(name)
        if self.distribution is None and present not in _FACTORS:
            raise RuleError(
                "have key and values, or a distribution and its parameters; use among = [...] or "
                "between = [from, to] instead of values for random levels, and factor = NAME instead of key "
                "for levels that set several keys"
            )
        if self.distribution and present != {"distribution", *PARAMETERS[self.distribution]}:
            needs = ", ".join(PARAMETERS[self.distribution])
            raise RuleError(f"have only {needs} besides distribution = {self.distribution!r}")

    @property
    def is_random(self) -> bool:
        """True if levels of a factor are drawn."""
        return self.among is not None or self.between is not None


_RANGES: Final = ("count", "at", "radius", "duration", "share", "drift")
_FACTORS: Final = (
    {"key", "values"}, {"key", "among"}, {"key", "between"}, {"factor", "values"}, {"factor", "among"},
)  # fmt: skip


class _StudyFile(CommonStudyFields, frozen=True, kw_only=True):
    """Content of a study file."""

    seeds: _Seeds = 10
    """Seeds, from 1 on, for each strategy and variant."""
    tuning_seeds: _Seeds = 10
    """Seeds for `--tuning`, which tests never use."""
    set: Annotated[dict[str, Any], Meta(description="a table of keys of the scenario")] = msgspec.field(
        default_factory=dict
    )
    """Overridden keys of the scenario, such as "run.duration" = 300."""
    conditions: Literal["drawn", "as written"] = "drawn"
    """Drawn: each seed draws starts, items, odometry errors and shadowing unless set here."""
    vary: tuple[VaryTable, ...] = ()
    samples: Annotated[int, Meta(ge=1, le=MAX_SAMPLES)] | None = None
    """Number of cells drawn from the random factors."""


def load_study(path: Path, *, tuning: bool = False) -> Study:
    """Load a study from TOML, or from the `study.json` of a campaign. Raises AcrcError."""
    if path.suffix == ".json":
        return _load_json(path)
    check_exists(path, SHIPPED / "studies")
    if is_scenario(path):
        compared = command_line("campaign", path)
        raise AcrcError(f"{path}: is a scenario, not a study; to compare strategies in it: {compared}")
    table = settings.load(path, _StudyFile, "study", _MAX_BYTES)
    strategies = tuple(dict.fromkeys(table.strategies))
    for pair in table.primary:
        for name in pair:
            if name not in strategies:
                raise AcrcError(
                    f"{path}: primary: {name!r} is not one of the study's strategies: {', '.join(strategies)}"
                )
    scenario = (path.parent / table.scenario).resolve()
    try:
        factors = _factors(table.vary, table.samples, FIRST_TUNING_SEED if tuning else FIRST_SEED)
        task = task_declaration(scenario, tuple(table.set.items()))
        check_names(table.metric, task)
    except AcrcError as error:
        raise AcrcError(f"{path}: {error}") from None
    shared = {name: getattr(table, name) for name in CommonStudyFields.__struct_fields__} | {
        "scenario": str(scenario),
        "strategies": strategies,
    }
    study = Study(
        name=path.stem,
        task=task,
        seeds=table.tuning_seeds if tuning else table.seeds,
        tuning=tuning,
        settings=tuple(table.set.items()),
        conditions=table.conditions,
        modules=str(path.parent.resolve()) if table.metric else "",
        **factors,
        **shared,
    )
    if unknown := table.margins.keys() - study.metrics():
        raise AcrcError(f"{path}: margins.{min(unknown)}: must be {choice(study.metrics())}")
    return study


def task_declaration(scenario: Path, own: Variant) -> TaskDeclaration:
    """Return the declaration of a scenario's task; `own`: keys set in the scenario. Raises AcrcError."""
    table = toml_tables(read_text(scenario, "scenario"), scenario).get("task")
    named = table.get("use", DEFAULT) if isinstance(table, Mapping) else DEFAULT
    try:
        return task_setup(str(dict(own).get("task.use", named)), {}).declaration
    except AcrcError as error:
        raise AcrcError(f"{scenario}: {error}") from None


def _load_json(path: Path) -> Study:
    """Load a study from JSON; its paths are relative to the file."""
    study = typed_json.read(path, Study, "study of a campaign")
    modules = study.modules and str((path.parent / study.modules).resolve())
    scenario = str((path.parent / study.scenario).resolve())
    return msgspec.structs.replace(study, scenario=scenario, modules=modules)


def _factors(tables: Sequence[VaryTable], samples: int | None, seed: int) -> dict[str, Any]:
    """Return fields of the study: factors, drawn cells and distributions. Raises AcrcError."""
    fixed: list[Factor] = []
    drawn: list[Factor] = []
    spans: list[RandomFactor] = []
    taken: set[str] = set()
    for index, table in enumerate(tables):
        if table.distribution is not None:
            continue
        factor = _factor(table, f"vary[{index}]")
        keys = {factor.key, *(key for level in factor.levels for key, _ in level)}
        if keys & taken:
            raise AcrcError(
                f"vary[{index}]: {min(keys & taken)} is set by another factor, too; use one factor"
            )
        taken |= keys
        if not table.is_random:
            fixed.append(factor)
            continue
        if _NEVER_RANDOM in keys:
            raise AcrcError(f"vary[{index}]: {_NEVER_RANDOM} cannot be random; use values = [...]")
        drawn.append(factor)
        spans.append(RandomFactor(factor.key, factor.values, table.between or (0, 0)))
    if bool(spans) != (samples is not None):
        if samples:
            raise AcrcError(f"samples is {samples}, but no factor is random (among or between)")
        raise AcrcError("samples is missing; it is required for random factors (among or between)")
    cells = draw_cells(spans, samples, seed) if samples is not None else ()
    return {
        "factors": tuple(fixed),
        "random": tuple(_with_drawn_levels(one, cells) for one in drawn),
        "cells": cells,
        "distributions": tuple(_distribution(table) for table in tables if table.distribution is not None),
    }


def _factor(table: VaryTable, where: str) -> Factor:
    values = table.values or table.among or ()
    if table.factor is None:
        assert table.key is not None
        return Factor(table.key, values)
    for index, value in enumerate(values):
        if not (isinstance(value, Mapping) and isinstance(value.get("name"), str) and len(value) > 1):
            raise AcrcError(
                f"{where}.{'values' if table.values else 'among'}[{index}] is {value!r}; must be a table "
                'with name and keys of the scenario, such as {name = "maze", map = "../maps/maze.yaml"}'
            )
    names = tuple(value["name"] for value in values)
    if len(set(names)) < len(names):
        raise AcrcError(f"{where}: names of levels must be unique: {', '.join(names)}")
    levels = tuple(tuple(_dotted_items(value, ("name",))) for value in values)
    return Factor(table.factor, names, levels)


def _dotted_items(table: Mapping[str, Any], without: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values of nested tables."""
    for key, value in table.items():
        if key in without:
            continue
        if isinstance(value, Mapping):
            yield from ((f"{key}.{part}", inner) for part, inner in _dotted_items(value))
        else:
            yield key, value


def _with_drawn_levels(factor: Factor, cells: Sequence[Variant]) -> Factor:
    """Return a random factor with the drawn levels only, in the order of the file or ascending."""
    drawn = {repr(value): value for cell in cells for key, value in cell if key == factor.key}
    if not factor.values:
        return Factor(factor.key, tuple(sorted(drawn.values())))
    indices = [index for index, value in enumerate(factor.values) if repr(value) in drawn]
    levels = tuple(factor.levels[index] for index in indices) if factor.levels else ()
    return Factor(factor.key, tuple(factor.values[index] for index in indices), levels)


def _distribution(table: VaryTable) -> Distribution:
    assert table.distribution is not None
    parameters = ((name, getattr(table, name)) for name in PARAMETERS[table.distribution])
    spans = ((name, (one, one) if isinstance(one, float) else one) for name, one in parameters)
    return Distribution(table.distribution, tuple(spans))
