"""Input files of a study, and preregistered plans, frozen before the first run."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from acrc_testbed.experiments.study import Study, Trial, differences
from acrc_testbed.experiments.trial_settings import draw_settings
from actors.floor import offices
from actors.floor.map_file import load_map
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.settings import read_text, toml_tables
from actors.user_code import is_installed
from deploy.scenario.scenario_file import Overrides, load_scenario, map_files, strategy_files
from deploy.scenario.tables import Scenario


class StudyInputs(NamedTuple):
    """Input files of a study with their relative paths."""

    scenario: str
    """Relative path of the scenario, a key of `files`."""
    files: dict[str, Path]
    """Files by path relative to their common folder."""
    modules: str
    """Relative path of the folder of the metrics' functions; empty without own metrics."""


def study_inputs(study: Study) -> StudyInputs:
    """Return all files read by the study's runs, with their relative paths.

    Raises AcrcError for missing files and absolute paths.
    """
    scenario = Path(os.path.realpath(study.scenario))
    if not scenario.is_file():
        raise AcrcError(f"{scenario}: missing; the campaign's runs were made with it")
    settings = [study.settings_of(variant) for variant in study.variants()]
    for text in _texts([toml_tables(read_text(scenario, "scenario"), scenario), settings]):
        if Path(text).is_absolute():
            raise AcrcError(f"{scenario}: {text} is an absolute path; make it relative to the scenario")
    read = (Path(os.path.realpath(path)) for path in _input_files(study))
    named = list(dict.fromkeys([scenario, *read]))
    top = Path(os.path.commonpath([path.parent for path in named]))
    files = {path.relative_to(top).as_posix(): path for path in named}
    modules = study.modules and Path(os.path.relpath(os.path.realpath(study.modules), top)).as_posix()
    return StudyInputs(scenario.relative_to(top).as_posix(), dict(sorted(files.items())), modules)


def _texts(value: Any) -> Iterator[str]:
    """Yield every text in nested tables and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from _texts(list(value.values()))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one)


def _input_files(study: Study) -> Iterator[Path]:
    for metric in study.metric:
        yield from strategy_files(metric.use, Path(study.modules))
    for variant in study.variants():
        for strategy in study.strategies:
            draws = draw_settings(study, Trial(strategy, study.first_seed, variant))
            own = (*study.settings_of(variant), *draws.items())
            overrides = Overrides(strategy=strategy, settings=own)
            yield from _scenario_files(load_scenario(Path(study.scenario), overrides), strategy)


def _scenario_files(scenario: Scenario, strategy: str) -> Iterator[Path]:
    """Yield the files of map (with image), robot models, and code of the user's strategy and task."""
    if offices.is_name(scenario.map):
        load_map(scenario.map)  # a generated floor has no file; check its name
    else:
        yield from map_files(Path(scenario.map))
    for model in (scenario.robots.model, *(robot.model for robot in scenario.robot)):
        if model is not None and model.endswith(".toml"):
            yield Path(model)
    for use in (strategy, scenario.task.use):
        if ":" in use and scenario.run.modules:
            yield from strategy_files(use, Path(scenario.run.modules))


SUFFIX: Final = ".frozen.json"
_NOT_FROZEN: Final = frozenset({"name", "scenario", "seeds", "primary", "modules"})
"""Fields of a study that may change or are compared separately."""
_MAX_BYTES: Final = 1 << 20


class FrozenPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Plan of a study, declared before the first run."""

    commit: str
    """Commit of the testbed, without uncommitted changes."""
    study: Study
    """Study with margins and declared comparisons; its scenario is a file name without folders."""
    files: tuple[tuple[str, str], ...]
    """Name, without folders, and SHA-256 of the scenario, all files that it refers to, and the code of
    metrics."""
    looks: tuple[int, ...]
    """Stopping rule: numbers of pairs at the interim looks; empty: all seeds are run."""
    study_sha256: str
    """SHA-256 of study and files; does not depend on the commit."""
    sha256: str
    """SHA-256 of all other fields."""


def freeze(study: Study, commit: str, looks: Sequence[int]) -> bytes:
    """Return the plan of a study as JSON. Raises AcrcError for uncommitted changes and missing files."""
    if commit.endswith("+"):
        raise AcrcError(
            f"the software has changes since commit {commit[:-1]}; commit them before freezing a plan"
        )
    content: dict[str, Any] = {
        "study": msgspec.to_builtins(
            msgspec.structs.replace(study, scenario=Path(study.scenario).name, modules="")
        ),
        "files": _file_hashes(study),
    }
    content["study_sha256"] = _sha256(content)
    content |= {"commit": commit, "looks": list(looks)}
    return (
        msgspec.json.format(msgspec.json.encode({**content, "sha256": _sha256(content)}, order="sorted"))
        + b"\n"
    )


def read_plan(path: Path) -> FrozenPlan:
    """Read a frozen plan. Raises AcrcError if it is missing or its hashes do not match."""
    plan = typed_json.read(path, FrozenPlan, "frozen plan", _MAX_BYTES)
    content = msgspec.json.decode(regular_file.read_bytes(path, _MAX_BYTES))
    for name, over in (
        ("sha256", {key: value for key, value in content.items() if key != "sha256"}),
        ("study_sha256", {key: content[key] for key in ("study", "files")}),
    ):
        if (found := _sha256(over)) != content[name]:
            raise AcrcError(
                f"{path}: changed after it was frozen: {name} is {content[name]}, that of the content {found}"
            )
    return plan


def deviations(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """Yield a sentence for each field of a study that differs from the plan, except files."""
    then = plan.study
    if study.seeds != then.seeds:
        yield f"seeds is {study.seeds}, planned: {then.seeds}"
    for one, other in study.primary_pairs:
        if (one, other) not in then.primary_pairs:
            yield f"the comparison of {one} with {other} was not planned"
    for one, other in then.primary_pairs:
        if (one, other) not in study.primary_pairs:
            yield f"the planned comparison of {one} with {other} is no longer declared"
    for field, (here, frozen) in differences(study, then).items():
        if field not in _NOT_FROZEN:
            yield f"{field} is {here}, planned: {frozen}"


def changed_files(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """Yield a sentence for each input file that differs from the plan. Raises AcrcError."""
    here, frozen = Counter(_file_hashes(study)), Counter(plan.files)
    now, before = ({name for name, _ in files} for files in (here, frozen))
    for name in dict.fromkeys(name for name, _ in (*(frozen - here), *(here - frozen))):
        if name not in now:
            yield f"{name} is no longer an input file"
        elif name not in before:
            yield f"{name} is a new input file"
        else:
            yield f"the content of {name} was changed"


def _file_hashes(study: Study) -> list[tuple[str, str]]:
    installed = (one.use.partition(":")[0] for one in study.metric)
    specs = (find_spec(module) for module in installed if is_installed(module))
    origins = {Path(one.origin) for one in specs if one is not None and one.origin is not None}
    files = (*study_inputs(study).files.values(), *origins)
    return sorted((path.name, hashlib.sha256(regular_file.read_bytes(path)).hexdigest()) for path in files)


def _sha256(value: Any) -> str:
    """Return the SHA-256 of the value as compact UTF-8 JSON with sorted keys."""
    return hashlib.sha256(msgspec.json.encode(value, order="sorted")).hexdigest()
