"""The file of a study, checked, and the study that it means."""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from actors import table_wording
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.table import A_POINT, FileTable, Point, Right, as_tuples
from experiments.study.draws import PARAMETERS
from experiments.study.study import Distribution, Factor, Study

MOST_SEEDS: Final = 100_000
_LARGEST: Final = 1 << 20


def _as_pair(value: object) -> object:
    """A number alone is the range from it to itself."""
    return (value, value) if isinstance(value, int | float) else as_tuples(value)


def _in_order(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError
    return pair


_RANGE: Final = "a number from 0 on, or a range [from, to] of them"
Range = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=0, le=1e6)]],
    BeforeValidator(_as_pair),
    AfterValidator(_in_order),
    Right(_RANGE),
]


class VaryTable(FileTable):
    """[[vary]]: a key of the scenario and its values one after the other, or what is drawn for each seed."""

    key: Annotated[
        str | None, Field(min_length=1), Right('a key of the scenario, such as "robots.count"')
    ] = None
    values: Annotated[
        tuple[Any, ...] | None,
        BeforeValidator(as_tuples),
        Field(min_length=1),
        Right("a list of at least one value"),
    ] = None
    distribution: Annotated[
        Literal["kills", "jams", "dropout", "odometry", "doors", "closures", "tasks"] | None,
        Right('"kills", "jams", "dropout", "odometry", "doors", "closures" or "tasks"'),
    ] = None
    """What is drawn; its parameters are those of `study.draws.PARAMETERS`."""
    count: Range | None = None
    """How many."""
    at: Range | None = None
    """When, s."""
    radius: Range | None = None
    """Of a jammer's reach, or of what stands in a door, m."""
    duration: Range | None = None
    """s."""
    share: Range | None = None
    drift: Range | None = None
    points: Annotated[
        tuple[Point, ...] | None,
        BeforeValidator(as_tuples),
        Field(min_length=1),
        Right("a list of points [x, y] in m", item=A_POINT),
    ] = None

    @model_validator(mode="after")
    def _whole(self) -> "VaryTable":
        given = {name for name in _PARAMETERS if getattr(self, name) is not None}
        if self.distribution is None:
            if self.key is None or self.values is None or given:
                raise ValueError("have a key and its values, or a distribution and its parameters")
            return self
        needed = set(PARAMETERS[self.distribution])
        if self.key is not None or self.values is not None or given != needed:
            needs = ", ".join(PARAMETERS[self.distribution])
            raise ValueError(f"have {needs} beside the distribution {self.distribution}, and nothing else")
        return self


_PARAMETERS: Final = tuple(
    name for name in VaryTable.model_fields if name not in {"key", "values", "distribution"}
)


class StudyTable(FileTable):
    """The file."""

    scenario: Annotated[
        str, Field(min_length=1), Right("the path of a scenario, relative to the study's file")
    ]
    strategies: Annotated[
        tuple[str, ...],
        BeforeValidator(as_tuples),
        Field(min_length=1),
        Right('a list of strategies, such as ["none", "chapter"]'),
    ]
    seeds: Annotated[int, Field(ge=1, le=MOST_SEEDS), Right(f"a whole number from 1 to {MOST_SEEDS}")] = 10
    """So many seeds, from 1 on, for each strategy and variant."""
    tuning_seeds: Annotated[
        int, Field(ge=1, le=MOST_SEEDS), Right(f"a whole number from 1 to {MOST_SEEDS}")
    ] = 10
    """So many for `--tuning`: other ones, which no test ever has."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Keys of the scenario that are other than in its file, such as "run.duration" = 300."""
    vary: Annotated[tuple[VaryTable, ...], BeforeValidator(as_tuples)] = ()
    primary: Annotated[
        tuple[Annotated[tuple[str, str], BeforeValidator(as_tuples)], ...],
        BeforeValidator(as_tuples),
        Right('a list of pairs of strategies, such as [["chapter", "none"]]'),
    ] = ()
    """The comparisons that the study is for, declared before it is carried out."""
    primary_metric: Annotated[str, Field(min_length=1), Right('a metric, such as "places"')] = "lexicographic"
    """By which these are decided; the default is the chapter's order: places, then running time."""
    margin_places: Annotated[float, Field(gt=0, le=1e6), Right("a number above 0")] = 1.0
    """Strategies whose mean numbers of places differ by less are as good as each other."""
    margin_s: Annotated[float, Field(gt=0, le=1e6), Right("a number above 0")] = 10.0
    """The same of times, s."""
    failed_runs: Annotated[Literal["worst", "left out"], Right('"worst" or "left out"')] = "worst"
    """What a run that failed counts as: one that did nothing, or none."""
    isolated: bool = False
    """Every run is made as isolated processes, for strategies of strangers."""


def load_study(path: Path, *, tuning: bool = False) -> Study:
    """The study in a file, also in one that a campaign has written (`study.json`). Raises AcrcError."""
    if path.suffix == ".json":
        return _written(path)
    table = table_wording.load(path, StudyTable, "study", _LARGEST)
    strategies = tuple(dict.fromkeys(table.strategies))
    for pair in table.primary:
        for name in pair:
            if name not in strategies:
                raise AcrcError(
                    f"{path}: primary compares {name!r}, which is none of the study's strategies: "
                    f"{', '.join(strategies)}"
                )
    return Study(
        name=path.stem,
        scenario=str((path.parent / table.scenario).resolve()),
        strategies=strategies,
        seeds=table.tuning_seeds if tuning else table.seeds,
        tuning=tuning,
        settings=tuple(table.set.items()),
        factors=tuple(Factor(one.key, one.values) for one in table.vary if one.key and one.values),
        primary=table.primary,
        distributions=tuple(_distribution(one) for one in table.vary if one.distribution),
        primary_metric=table.primary_metric,
        isolated=table.isolated,
        margin_places=table.margin_places,
        margin_s=table.margin_s,
        failed_runs=table.failed_runs,
    )


def _distribution(table: VaryTable) -> Distribution:
    assert table.distribution is not None
    names = PARAMETERS[table.distribution]
    return Distribution(table.distribution, tuple((name, getattr(table, name)) for name in names))


def _written(path: Path) -> Study:
    """A path in it is relative to the file, as in any study's."""
    study = typed_json.read(path, Study, "study of a campaign")
    return msgspec.structs.replace(study, scenario=str((path.parent / study.scenario).resolve()))
