"""The file of a study, checked, and the study that it means."""

from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
from pydantic import BeforeValidator, Field

from actors import table_wording
from actors.runtime.errors import AcrcError
from actors.table import Right, Table, as_tuples
from experiments.study.study import Factor, Study

MOST_SEEDS: Final = 100_000
_LARGEST: Final = 1 << 20


class StudyError(AcrcError):
    """A study that cannot be carried out."""


class VaryTable(Table):
    """[[vary]]: a key of the scenario, and the values that it takes one after the other."""

    key: Annotated[str, Field(min_length=1), Right('a key of the scenario, such as "robots.count"')]
    values: Annotated[
        tuple[Any, ...],
        BeforeValidator(as_tuples),
        Field(min_length=1),
        Right("a list of at least one value"),
    ]


class StudyTable(Table):
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


def load_study(path: Path, *, tuning: bool = False) -> Study:
    """The study in a file, also in one that a campaign has written (`study.json`). Raises StudyError."""
    if path.suffix == ".json":
        return _written(path)
    table = table_wording.load(path, StudyTable, "study", StudyError, _LARGEST)
    strategies = tuple(dict.fromkeys(table.strategies))
    for pair in table.primary:
        for name in pair:
            if name not in strategies:
                raise StudyError(
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
        factors=tuple(Factor(one.key, one.values) for one in table.vary),
        primary=table.primary,
    )


def _written(path: Path) -> Study:
    """A path in it is relative to the file, as in any study's."""
    try:
        study = msgspec.json.decode(path.read_bytes(), type=Study)
    except (OSError, msgspec.DecodeError) as error:
        raise StudyError(f"{path}: cannot be read as the study of a campaign: {error}") from None
    return msgspec.structs.replace(study, scenario=str((path.parent / study.scenario).resolve()))
