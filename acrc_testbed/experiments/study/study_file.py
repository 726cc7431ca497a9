"""The file of a study, checked, and the study that it means."""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
from pydantic import BeforeValidator, Field

from acrc_testbed.experiments.study.study import FIRST_SEED, FIRST_TUNING_SEED, Study
from acrc_testbed.experiments.study.vary_table import VaryTable, factors_of
from actors import table_wording
from actors.installation.repository import SHIPPED
from actors.installation.usage import typed
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.table import FileTable, Right, as_tuples
from deploy.scenario.scenario_file import check_there, is_scenario

MOST_SEEDS: Final = 100_000
MOST_SAMPLES: Final = 1000
_LARGEST: Final = 1 << 20
_SHARED: Final = (
    "primary", "primary_metric", "isolated", "margin_places", "margin_s", "failed_runs", "conditions"
)  # fmt: skip
"""Keys of the file that a study takes as they are."""


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
    conditions: Annotated[Literal["drawn", "as written"], Right('"drawn" or "as written"')] = "drawn"
    """Whether seeds draw starts, places, odometry's errors and shadowing where nothing here sets them."""
    vary: Annotated[tuple[VaryTable, ...], BeforeValidator(as_tuples)] = ()
    samples: Annotated[
        int | None, Field(ge=1, le=MOST_SAMPLES), Right(f"a whole number from 1 to {MOST_SAMPLES}")
    ] = None
    """So many cells are drawn from the random factors."""
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
    check_there(path, SHIPPED / "studies")
    if is_scenario(path):
        compared = typed("campaign", path)
        raise AcrcError(f"{path}: is a scenario, must be a study; to compare strategies in it: {compared}")
    table = table_wording.load(path, StudyTable, "study", _LARGEST)
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
    return Study(
        name=path.stem,
        scenario=str((path.parent / table.scenario).resolve()),
        strategies=strategies,
        seeds=table.tuning_seeds if tuning else table.seeds,
        tuning=tuning,
        settings=tuple(table.set.items()),
        factors=made.fixed,
        distributions=made.distributions,
        random=made.random,
        cells=made.cells,
        **{name: getattr(table, name) for name in _SHARED},
    )


def _written(path: Path) -> Study:
    """A path in it is relative to the file, as in any study's."""
    study = typed_json.read(path, Study, "study of a campaign")
    return msgspec.structs.replace(study, scenario=str((path.parent / study.scenario).resolve()))
