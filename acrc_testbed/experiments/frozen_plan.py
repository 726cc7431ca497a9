"""Inputs of a study, and plans that are frozen before its first run."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from acrc_testbed.experiments.draws import drawn
from acrc_testbed.experiments.study import Study, Trial, differences
from actors.floor import offices
from actors.floor.map_file import load_map
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.settings import read_text, toml_tables
from deploy.scenario.scenario_file import Overrides, load_scenario, map_files, strategy_files
from deploy.scenario.tables import Scenario


class Inputs(NamedTuple):
    """Files, and where they lie relative to one another."""

    scenario: str
    """The study's scenario, one of the files."""
    files: dict[str, Path]
    """Every file by its path in a folder of their own."""


def inputs(study: Study) -> Inputs:
    """Everything that the study's runs read, in folders that stand to one another as they did.

    Raises AcrcError if something is missing, or named so that others could not find it.
    """
    scenario = Path(os.path.realpath(study.scenario))
    if not scenario.is_file():
        raise AcrcError(f"{scenario}: is no file any more, but the campaign's runs have read it")
    told = (
        toml_tables(read_text(scenario, "scenario"), scenario),
        [study.settings_of(variant) for variant in study.variants()],
    )
    for text in _texts(told):
        if Path(text).is_absolute():
            raise AcrcError(
                f"{scenario}: names {text}; must be relative to the scenario, so that others find it, too"
            )
    named = list(dict.fromkeys([scenario, *_named(study)]))
    top = Path(os.path.commonpath([path.parent for path in named]))
    files = {path.relative_to(top).as_posix(): path for path in named}
    return Inputs(scenario.relative_to(top).as_posix(), dict(sorted(files.items())))


def _texts(told: Any) -> Iterator[str]:
    """Every text in nested tables and lists."""
    if isinstance(told, str):
        yield told
    elif isinstance(told, dict):
        yield from _texts(list(told.values()))
    elif isinstance(told, list | tuple):
        for one in told:
            yield from _texts(one)


def _named(study: Study) -> Iterator[Path]:
    for variant in study.variants():
        for strategy in study.strategies:
            draws = drawn(study, Trial(strategy, study.first_seed, variant))
            own = (*study.settings_of(variant), *draws.items())
            overrides = Overrides(strategy=strategy, settings=own)
            for path in _files(load_scenario(Path(study.scenario), overrides), strategy):
                yield Path(os.path.realpath(path))


def _files(scenario: Scenario, strategy: str) -> Iterator[Path]:
    """Of a map file also the image; of a strategy of one's own its module, or all of its package."""
    if offices.is_name(scenario.map):
        load_map(scenario.map)  # a drawn floor is its name: what is none does not travel
    else:
        yield from map_files(Path(scenario.map))
    for model in (scenario.robots.model, *(robot.model for robot in scenario.robot)):
        if model is not None and model.endswith(".toml"):
            yield Path(model)
    if ":" in strategy and scenario.run.modules:
        yield from strategy_files(strategy, Path(scenario.run.modules))


SUFFIX: Final = ".frozen.json"
_APART: Final = frozenset({"name", "scenario", "seeds", "primary"})
"""Of a study: what may change, what its files say, and what is compared in words of its own."""
_LARGEST: Final = 1 << 20


class FrozenPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was declared before the first run."""

    commit: str
    """Of the software, without uncommitted changes."""
    study: Study
    """With all margins and declared comparisons; its scenario is named without folders."""
    files: tuple[tuple[str, str], ...]
    """Name, without folders, and SHA-256 of the scenario and of every file that it names."""
    looks: tuple[int, ...]
    """Stop rule: numbers of pairs at which the comparisons are looked at; empty: all seeds are run."""
    study_sha256: str
    """Of study and files: equal for equal studies at whatever commit."""
    sha256: str
    """Of all the above."""


def freeze(study: Study, commit: str, looks: Sequence[int]) -> bytes:
    """Return the plan of a study as a file. Raises AcrcError for changed software and missing files."""
    if commit.endswith("+"):
        raise AcrcError(
            f"the software was changed since its commit {commit[:-1]}; must be committed before a plan is "
            "frozen, so that others can get it"
        )
    told: dict[str, Any] = {
        "study": msgspec.to_builtins(msgspec.structs.replace(study, scenario=Path(study.scenario).name)),
        "files": _hashed(study),
    }
    told["study_sha256"] = _sha256(told)
    told |= {"commit": commit, "looks": list(looks)}
    return msgspec.json.format(msgspec.json.encode({**told, "sha256": _sha256(told)}, order="sorted")) + b"\n"


def read(path: Path) -> FrozenPlan:
    """The plan in a file. Raises AcrcError for none, and for one whose content is not what was hashed."""
    plan = typed_json.read(path, FrozenPlan, "frozen plan", _LARGEST)
    told = msgspec.json.decode(regular_file.read_bytes(path, _LARGEST))
    for name, over in (
        ("sha256", {key: value for key, value in told.items() if key != "sha256"}),
        ("study_sha256", {key: told[key] for key in ("study", "files")}),
    ):
        if (found := _sha256(over)) != told[name]:
            raise AcrcError(
                f"{path}: no frozen plan: was changed after it was frozen, as its {name} is {told[name]}, "
                f"but that of its content {found}"
            )
    return plan


def departures(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """A sentence for each thing that a study has otherwise than in the plan, but for the files."""
    then = plan.study
    if study.seeds != then.seeds:
        yield f"seeds is {study.seeds}, frozen was {then.seeds}"
    for one, other in study.primary_pairs:
        if (one, other) not in then.primary_pairs:
            yield f"the comparison of {one} with {other} was not declared beforehand"
    for one, other in then.primary_pairs:
        if (one, other) not in study.primary_pairs:
            yield f"the comparison of {one} with {other} was declared beforehand, and is not any more"
    for field, (here, frozen) in differences(study, then).items():
        if field not in _APART:
            yield f"{field} is {here}, frozen was {frozen}"


def changed_files(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """A sentence for each file that a study reads otherwise than in the plan. Raises AcrcError."""
    here, frozen = Counter(_hashed(study)), Counter(plan.files)
    names = dict.fromkeys(name for name, _ in (*(frozen - here), *(here - frozen)))
    for name in names:
        before, now = ({found for of, found in some if of == name} for some in (frozen, here))
        if not now:
            yield f"{name} is not read any more"
        elif not before:
            yield f"{name} was not read"
        else:
            yield f"{name} has another content"


def _hashed(study: Study) -> list[tuple[str, str]]:
    files = inputs(study).files.values()
    return sorted((path.name, hashlib.sha256(regular_file.read_bytes(path)).hexdigest()) for path in files)


def _sha256(told: Any) -> str:
    """Of the JSON with sorted keys and without spaces, in UTF-8."""
    return hashlib.sha256(msgspec.json.encode(told, order="sorted")).hexdigest()
